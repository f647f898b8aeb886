"""The chart as a picture: error over time, both logarithmic, for both measures side by side."""

from __future__ import annotations

import math
import textwrap
from typing import TYPE_CHECKING, Any, Dict, List, Sequence, Tuple

from gpurt.chart.analyse import Result, crossings, pareto_front

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours, told apart by colour-blind readers too; markers tell them apart in grey.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "osD^vPX"
TITLES = {"relmse": "relMSE", "trimmed": "relMSE without the worst 0.1 % of the pixels"}
LABEL_WIDTH = 20  # letters that fit beside a panel
STYLE: Dict[str, Any] = {
    "font.size": 10, "axes.titlesize": 11, "axes.titleweight": "bold", "axes.edgecolor": "#808080",
    "axes.linewidth": 0.8, "xtick.color": "#404040", "ytick.color": "#404040", "svg.fonttype": "none",
    "svg.hashsalt": "gpurt",
}


def color(index: int) -> str:
    return COLORS[index % len(COLORS)]


def format_seconds(value: float) -> str:
    if value < 1e-3:
        return f"{value * 1e6:.3g} µs"
    if value < 1:
        return f"{value * 1e3:.3g} ms"
    return f"{value:.3g} s"


def spread_labels(heights: Sequence[float], gap: float) -> List[float]:
    """Moves labels apart, as little as needed, keeping their order."""
    order = sorted(range(len(heights)), key=lambda i: heights[i])
    # Labels that touch form a block, which is centred on the mean of where its labels want to be.
    blocks: List[List[int]] = []
    for i in order:
        blocks.append([i])
        while len(blocks) > 1:
            lower, upper = (sum(heights[k] for k in b) / len(b) for b in blocks[-2:])
            if upper - lower >= gap * (len(blocks[-2]) + len(blocks[-1])) / 2:
                break
            top = blocks.pop()
            blocks[-1] += top
    placed = [0.0] * len(heights)
    for block in blocks:
        centre = sum(heights[k] for k in block) / len(block)
        for position, k in enumerate(block):
            placed[k] = centre + (position - (len(block) - 1) / 2) * gap
    return placed


# The end of a curve in data units, its label and its colour.
End = Tuple[float, float, str, str]


def draw_panel(axes: "Axes", results: Sequence[Result], measure: str) -> List[End]:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(True, which="major", color="#e0e0e0", linewidth=0.8)
    axes.grid(True, which="minor", color="#f2f2f2", linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_title(TITLES[measure], loc="left")
    axes.set_xlabel("seconds, with loading and building")

    front = pareto_front(results, measure)
    if len(front) > 1:
        axes.plot([p[0] for p in front], [p[1] for p in front], color="#d0d0d0", linewidth=7, solid_capstyle="round",
                  solid_joinstyle="round", zorder=1)
    ends: List[End] = []
    for index, result in enumerate(results):
        points = [p for p in result.points if p.error(measure).median > 0]
        if not points:
            continue
        times = [p.seconds for p in points]
        medians = [p.error(measure).median for p in points]
        # A seed below the reference's noise has no logarithm: the band ends at the median there.
        lows = [p.error(measure).low if p.error(measure).low > 0 else p.error(measure).median for p in points]
        axes.fill_between(times, lows, [p.error(measure).high for p in points], color=color(index), alpha=0.15,
                          linewidth=0, zorder=2)
        axes.plot(times, medians, color=color(index), marker=MARKERS[index % len(MARKERS)], markersize=4.5,
                  linewidth=1.6, zorder=3)
        fit = result.fits[measure]
        slope = f"\nslope {fit.slope:+.2f}" if fit else ""
        ends.append((times[-1], medians[-1], textwrap.fill(result.name, LABEL_WIDTH) + slope, color(index)))
    crossed = [c for c in crossings(results, measure) if c.measured]
    if crossed:
        axes.scatter([c.seconds for c in crossed], [c.error for c in crossed], s=60, facecolors="none",
                     edgecolors="#404040", linewidths=1.1, zorder=4)
    axes.margins(x=0.04, y=0.06)
    return ends


def place_labels(axes: "Axes", ends: Sequence[End]) -> None:
    """Names at the ends of the curves, in a column at the right of the panel."""
    low, high = axes.get_ylim()
    scale = math.log(high / low)
    gap = 0.0475 * max((1 + text.count("\n") for _, _, text, _ in ends), default=1)
    placed = spread_labels([math.log(y / low) / scale for _, y, _, _ in ends], gap)
    for (x, y, text, ink), height in zip(ends, placed):
        axes.annotate(text, xy=(x, y), xycoords="data", xytext=(1.02, height), textcoords="axes fraction", color=ink,
                      fontsize=8.5, va="center", ha="left", linespacing=1.25, annotation_clip=False,
                      arrowprops={"arrowstyle": "-", "color": ink, "linewidth": 0.6, "alpha": 0.6,
                                  "shrinkA": 1, "shrinkB": 4})


def draw(results: Sequence[Result], title: str, subtitle: str, notes: str) -> "Figure":
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter
    with rc_context(STYLE):
        figure = Figure(figsize=(13, 5.6))
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        ends = [draw_panel(axes, results, measure) for axes, measure in zip(panels, ("relmse", "trimmed"))]
        for axes, ends_of_panel in zip(panels, ends):  # the panels share their limits, so after both are drawn
            place_labels(axes, ends_of_panel)
        panels[1].tick_params(labelleft=True)
        panels[0].xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panels[0].xaxis.set_major_formatter("{x:g}")
        for axis in (panels[0].xaxis, panels[0].yaxis):
            axis.set_minor_formatter(NullFormatter())
        panels[0].set_ylabel("error against the reference")
        figure.text(0.055, 0.955, title, fontsize=14, fontweight="bold", va="center")
        figure.text(0.055, 0.905, subtitle, fontsize=9.5, color="#505050", va="center")
        figure.text(0.055, 0.022, notes, fontsize=8.5, color="#505050", va="center")
        figure.subplots_adjust(left=0.055, right=0.885, top=0.82, bottom=0.145, wspace=0.48)
    return figure


def save(figure: "Figure", path: str, kind: str) -> None:
    from matplotlib import rc_context
    with rc_context(STYLE):
        # Without the date equal measurements give equal files.
        figure.savefig(path, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else None)
