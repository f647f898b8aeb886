"""The files of a chart: CSV and JSON for programs, a page with the chart, tables and pictures for people."""

from __future__ import annotations

import base64
import csv
import dataclasses
import html
import io
import json
import math
from typing import Any, Dict, List, Optional, Sequence

import numpy as np

from gpurt import metrics
from gpurt.chart.analyse import MEASURES, Crossing, Result, crossings, pareto_front
from gpurt.chart.draw import TITLES, color, format_seconds
from gpurt.chart.measure import TimedPicture
from gpurt.metrics import Picture

CSV_COLUMNS = ("setting", "device", "pipeline", "accel", "triangle_test", "max_depth", "spp", "repeats",
               "load_seconds", "build_seconds", "render_seconds", "seconds", "relmse", "relmse_low", "relmse_high",
               "trimmed", "trimmed_low", "trimmed_high", "bias", "pareto_relmse", "pareto_trimmed")


def write_csv(path: str, results: Sequence[Result]) -> None:
    fronts = {m: {(name, t) for t, _, name in pareto_front(results, m)} for m in MEASURES}
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_COLUMNS)
        for r in results:
            resolved = r.curve.resolved
            for p in r.points:
                writer.writerow([
                    r.name, r.curve.device.name, resolved["pipeline"], resolved["accel"], resolved["triangle_test"],
                    resolved["max_depth"], p.spp, p.repeats, r.load_seconds, r.build_seconds, p.render_seconds,
                    p.seconds, p.relmse.median, p.relmse.low, p.relmse.high, p.trimmed.median, p.trimmed.low,
                    p.trimmed.high, p.bias, *(int((r.name, p.seconds) in fronts[m]) for m in MEASURES)])


def without_nan(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {k: without_nan(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(v) for v in value]
    return value


def write_json(path: str, about: Dict[str, Any], results: Sequence[Result], tables: Dict[str, Any],
               pictures: Sequence[TimedPicture]) -> None:
    document = {
        **about,
        "settings": [{
            "name": r.name, "device": dataclasses.asdict(r.curve.device), "asked": dataclasses.asdict(r.curve.setting),
            "resolved": r.curve.resolved, "load_seconds": r.load_seconds, "build_seconds": r.build_seconds,
            "fits": {m: dataclasses.asdict(f) if f else None for m, f in r.fits.items()},
            "points": [dataclasses.asdict(p) for p in r.points],
            "runs": [dataclasses.asdict(run) for run in r.curve.runs],
        } for r in results],
        "pareto": {m: [{"seconds": t, "error": e, "setting": n} for t, e, n in pareto_front(results, m)]
                   for m in MEASURES},
        "crossings": {m: [dataclasses.asdict(c) for c in crossings(results, m)] for m in MEASURES},
        "tables": tables,
        "pictures": [{"setting": p.name, "spp": p.spp, "seconds": p.seconds, **p.errors._asdict()} for p in pictures],
    }
    with open(path, "w", encoding="utf-8") as file:
        json.dump(without_nan(document), file, indent=1)
        file.write("\n")


# ---- the page ----

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1240px; margin: 2rem auto; padding: 0 1rem; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
p.about { color: #555; margin-top: 0; } svg { width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #e4e4e4; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom: 2px solid #bbb; }
td.best { font-weight: 700; } td.none { color: #aaa; }
.swatch { display: inline-block; width: .8em; height: .8em; border-radius: 50%; margin-right: .5em; }
.pictures { display: flex; flex-wrap: wrap; gap: 1.2rem; } figure { margin: 0; width: 280px; }
figure img { width: 100%; display: block; image-rendering: pixelated; margin-bottom: .3rem; }
figcaption { font-size: .85rem; color: #555; } figcaption b { color: #222; }
pre { background: #f5f5f5; padding: .8rem; overflow-x: auto; font-size: .85rem; }
"""


def data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def png_of(pixels: "np.ndarray[Any, np.dtype[np.uint8]]") -> bytes:
    from matplotlib.image import imsave
    buffer = io.BytesIO()
    imsave(buffer, pixels, format="png")
    return buffer.getvalue()


def error_map(picture: Picture, reference: Picture) -> bytes:
    """Root of each pixel's error, from 0 (black) to 1 (light): 1 is a pixel that is wrong by its own size."""
    from matplotlib import colormaps
    size = np.sqrt(metrics.pixel_errors(picture, reference)).clip(0, 1)
    return png_of((colormaps["magma"](size)[..., :3] * 255 + 0.5).astype(np.uint8))


def error_text(value: float) -> str:
    """One exponent digit is enough for an error."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def cells(values: List[Optional[float]], text: Any) -> str:
    best = min((v for v in values if v is not None and v > 0), default=None)
    row = ""
    for v in values:
        if v is None:
            row += '<td class="none">not measured</td>'
        else:
            row += f'<td class="best">{text(v)}</td>' if v == best else f"<td>{text(v)}</td>"
    return row


def setting_head(results: Sequence[Result], first: str) -> str:
    names = "".join(f'<th><span class="swatch" style="background:{color(i)}"></span>{html.escape(r.name)}</th>'
                    for i, r in enumerate(results))
    return f"<thead><tr><th>{first}</th>{names}</tr></thead>"


def equal_time_table(results: Sequence[Result], tables: Dict[str, Any], measure: str) -> str:
    rows = ""
    for row in tables["equal_time"]:
        values = [row["errors"][r.name][measure] for r in results]
        rows += f"<tr><td>{format_seconds(row['seconds'])}</td>{cells(values, error_text)}</tr>"
    return f"<table>{setting_head(results, 'after')}<tbody>{rows}</tbody></table>"


def equal_error_table(results: Sequence[Result], tables: Dict[str, Any], measure: str) -> str:
    rows = ""
    for row in tables["equal_error"][measure]:
        values = [row["seconds"][r.name] for r in results]
        rows += f"<tr><td>{row['error']:g}</td>{cells(values, format_seconds)}</tr>"
    return f"<table>{setting_head(results, 'down to')}<tbody>{rows}</tbody></table>"


def settings_table(results: Sequence[Result]) -> str:
    rows = ""
    for i, r in enumerate(results):
        c, last = r.curve.resolved, r.points[-1]
        slopes = "".join(f"<td>{f.slope:+.3f} ± {f.slope_error:.3f}</td>" if f else '<td class="none">one point</td>'
                         for f in (r.fits[m] for m in MEASURES))
        rows += (f'<tr><td><span class="swatch" style="background:{color(i)}"></span>{html.escape(r.name)}</td>'
                 f"<td>{html.escape(r.curve.device.name)}, {c['num_threads']} threads</td><td>{c['pipeline']}</td>"
                 f"<td>{c['accel']}</td><td>{format_seconds(r.load_seconds)}</td>"
                 f"<td>{format_seconds(r.build_seconds)}</td><td>{last.spp}</td><td>{last.bias:+.3%}</td>{slopes}</tr>")
    return ("<table><thead><tr><th>setting</th><th>device</th><th>pipeline</th><th>accel</th><th>load</th>"
            "<th>build</th><th>most spp</th><th>bias there</th><th>slope, relMSE</th>"
            f"<th>slope, trimmed</th></tr></thead><tbody>{rows}</tbody></table>")


def crossing_text(crossing: Crossing) -> str:
    when = "from" if crossing.measured else "by their slopes, from about"
    has = "has" if crossing.measured else "will have"
    return (f"{when} {format_seconds(crossing.seconds)} on, at {error_text(crossing.error)}, {crossing.below} {has} less "
            f"error than {crossing.above}")


def crossing_list(results: Sequence[Result], measure: str) -> str:
    lines = [crossing_text(c) for c in crossings(results, measure)]
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else '<p class="about">No curve crosses one of another kind, nor will by its slope.</p>'


def picture_figures(pictures: Sequence[TimedPicture], reference: Picture) -> str:
    figures = (f'<figure><img alt="reference" src="{data_uri(png_of(metrics.tonemap(reference)))}">'
               "<figcaption><b>reference</b></figcaption></figure>")
    maps = ""
    for p in pictures:
        name = html.escape(p.name)
        figures += (f'<figure><img alt="{name}" src="{data_uri(p.png)}"><figcaption><b>{name}</b><br>'
                    f"{format_seconds(p.seconds)}, {p.spp} samples per pixel<br>relMSE {error_text(p.errors.relmse)}, "
                    f"trimmed {error_text(p.errors.trimmed)}</figcaption></figure>")
        maps += (f'<figure><img alt="error of {name}" src="{data_uri(error_map(p.picture, reference))}">'
                 f"<figcaption><b>{name}</b></figcaption></figure>")
    return (f'<div class="pictures">{figures}</div><h2>Where the error is</h2><p class="about">Root of each pixel\'s '
            f'error: black is 0, the lightest 1 or more.</p><div class="pictures">{maps}</div>')


def write_page(path: str, title: str, command: str, svg: str, results: Sequence[Result],
               tables: Dict[str, Any], pictures: Sequence[TimedPicture], reference: Picture) -> None:
    svg = svg[svg.index("<svg"):]  # without the XML head, which a page does not have
    sections = ""
    for measure in MEASURES:
        sections += (f"<h2>Equal time: {TITLES[measure]}</h2>{equal_time_table(results, tables, measure)}"
                     f"<h2>Equal error: {TITLES[measure]}</h2>{equal_error_table(results, tables, measure)}"
                     f"<h2>Crossings: {TITLES[measure]}</h2>{crossing_list(results, measure)}")
    page = (f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head><body>'
            f"{svg}"
            f"<h2>Settings</h2>{settings_table(results)}"
            '<p class="about">Slopes are of error over render time without loading and building, later half of the points; '
            "-1 is an unbiased method.</p>"
            f"{sections}<h2>Pictures at equal time</h2>{picture_figures(pictures, reference)}"
            f"<h2>Again</h2><pre>{html.escape(command)}</pre></body></html>\n")
    with open(path, "w", encoding="utf-8") as file:
        file.write(page)
