"""Charts every scene of a folder that has references, and says where methods cross.

    python bench/chart_scenes.py SCENES -o DIR [--seconds S] [--repeats N] [--device D] [SCENE...]

SCENES holds the scenes and reference/references.json, which names each reference's scene, size, depth and noise. Makes a
chart (python -m gpurt.chart) in DIR/NAME for each, and DIR/crossings.md, .json and .png: for each scene the error of every
setting in the time of its shortest curve, and from when on which setting is ahead ("about": by the slopes of curves that
end before).
"""

import argparse
import json
import math
import pathlib
import sys

from gpurt.chart import __main__ as chart
from gpurt.chart.draw import MARKERS, color, format_seconds


def text_of(error):
    return "-" if error is None else f"{error:.2e}"


def last_errors(document, measure):
    """The largest time of the equal-time table that most settings cover, and each one's error there."""
    rows = document["tables"]["equal_time"]
    if not rows:
        return None, {}
    best = max(rows, key=lambda row: (sum(e[measure] is not None for e in row["errors"].values()), row["seconds"]))
    return best["seconds"], {name: e[measure] for name, e in best["errors"].items()}


def summary(documents, measure):
    settings = [s["name"] for s in next(iter(documents.values()))["settings"]]
    lines = [f"| scene | after | {' | '.join(settings)} | crossings |", "|---" * (len(settings) + 3) + "|"]
    for name, document in documents.items():
        seconds, errors = last_errors(document, measure)
        crossings = "; ".join(f"{c['below']} below {c['above']} from {'' if c['measured'] else 'about '}"
                              f"{format_seconds(c['seconds'])} on ({c['error']:.1e})"
                              for c in document["crossings"][measure])
        after = "-" if seconds is None else format_seconds(seconds)
        lines.append(f"| {name} | {after} | {' | '.join(text_of(errors.get(s)) for s in settings)} | {crossings or 'none'} |")
    return "\n".join(lines)


def draw(documents, measure, path):
    """A small chart for each scene; rings are where curves cross."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator
    columns = min(5, len(documents))
    rows = math.ceil(len(documents) / columns)
    figure = Figure(figsize=(2.9 * columns, 2.5 * rows + 0.8))
    panels = figure.subplots(rows, columns, squeeze=False).flat
    for axes, (name, document) in zip(panels, documents.items()):
        for index, setting in enumerate(document["settings"]):
            points = [(p["seconds"], p[measure]["median"]) for p in setting["points"] if p[measure]["median"] > 0]
            axes.loglog(*zip(*points), color=color(index), marker=MARKERS[index % len(MARKERS)], markersize=3,
                        linewidth=1.3, label=setting["name"])
        measured = [c for c in document["crossings"][measure] if c["measured"]]
        axes.scatter([c["seconds"] for c in measured], [c["error"] for c in measured], s=70, facecolors="none",
                     edgecolors="#404040", zorder=4)
        # A scene's times span about a decade, of which the powers of ten alone would say too little.
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_title(name, fontsize=9, loc="left")
        axes.grid(True, color="#e8e8e8", linewidth=0.6)
        axes.tick_params(labelsize=7)
    for axes in panels:
        axes.set_visible(False)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=len(labels), fontsize=9, frameon=False)
    figure.supylabel("relMSE" if measure == "relmse" else "relMSE, trimmed", fontsize=9)
    figure.supxlabel("seconds, with loading and building", fontsize=9, y=0.3 / (2.5 * rows + 0.8))
    figure.tight_layout(rect=(0.01, 0.42 / (2.5 * rows + 0.8), 1, 1))
    figure.savefig(path, dpi=110)


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path, metavar="SCENES")
    p.add_argument("names", nargs="*", metavar="SCENE", help="names of references (default: all of full depth)")
    p.add_argument("-o", "--output", type=pathlib.Path, required=True)
    p.add_argument("--seconds", type=float, default=10, help="of rendering for each setting and seed (default 10)")
    p.add_argument("--repeats", type=int, default=1, help="seeds (default 1)")
    p.add_argument("--device", default="auto")
    p.add_argument("--settings", action="append", help="as of python -m gpurt.chart")
    options = p.parse_intermixed_args()
    index = options.folder / "reference" / "references.json"
    references = json.loads(index.read_text(encoding="utf-8"))
    deepest = max(r["max_depth"] for r in references.values())
    names = options.names or [n for n, r in references.items() if r["max_depth"] == deepest]
    unknown = [n for n in names if n not in references]
    if unknown:
        sys.exit(f"error: {index} has no {', '.join(unknown)}; it has {', '.join(references)}")
    settings = [part for s in options.settings or [] for part in ("--settings", s)]
    documents = {}
    for name in names:
        folder = options.output / name
        print(f"== {name}", flush=True)
        status = chart.main([str(options.folder / references[name]["scene"]), "--reference",
                             str(index.parent / f"{name}.exr"), "--reference-noise", str(index), "-o", str(folder),
                             "--seconds", str(options.seconds), "--repeats", str(options.repeats),
                             "--device", options.device, *settings])
        if status != 0:
            sys.exit(f"error: no chart of {name}")
        documents[name] = json.loads((folder / "chart.json").read_text(encoding="utf-8"))
    text = "\n\n".join(f"{m}\n\n{summary(documents, m)}" for m in ("relmse", "trimmed"))
    (options.output / "crossings.md").write_text(text + "\n", encoding="utf-8")
    (options.output / "crossings.json").write_text(json.dumps(
        {name: {"crossings": d["crossings"], "pictures": d["pictures"]} for name, d in documents.items()}, indent=1) + "\n")
    draw(documents, "trimmed", options.output / "crossings.png")
    print(text)
    return 0 if all(math.isfinite(p["relmse"]) for d in documents.values() for p in d["pictures"]) else 1


if __name__ == "__main__":
    sys.exit(main())
