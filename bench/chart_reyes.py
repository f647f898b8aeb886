"""Charts REYES on scenes of patches: error against time over shading rate, samples and flatness, beside path tracing.

    python bench/chart_reyes.py SCENES -o DIR [--seconds S] [--repeats N] [--device D] [--processor-time] [NAME...]

SCENES holds NAME_patches.glb and reference/references.json with a reference of direct light for each: NAME_direct, or NAME
where direct light is all there is. Every curve runs over samples; one family of curves runs over shading rates, one over
flatness (the distance in pixels that micropolygons may leave the surface by) at the default rate, and path tracing of the
tessellation, emission and direct light alone, stands beside both. Makes DIR/reyes.md, .json and .png. Times are of rendering
alone; the files have those of commits too. For a page of one scene, with pictures, hand the same curves to python -m gpurt.chart.
"""

import argparse
import dataclasses
import json
import pathlib
import sys
import time

import gpurt
from gpurt import metrics
from gpurt.chart.__main__ import parse_noise
from gpurt.chart.analyse import summarise
from gpurt.chart.draw import MARKERS, format_seconds
from gpurt.chart.measure import Limits, measure as measure_curves
from gpurt.chart.settings import parse_setting

RATES = (0.0625, 0.25, 1.0, 4.0, 16.0)
FLATNESS = (0.05, 0.25, 0.95)
DEFAULT_RATE = 0.25
PATH = "path"
FAMILIES = ("shading rate", "flatness")


def name_of_rate(rate):
    return f"rate {rate:g}"


def name_of_flatness(flatness):
    return f"flatness {flatness:g}"


def settings_of(device, threads):
    """Of every curve."""
    curves = {PATH: "pipeline=path"}
    curves.update({name_of_rate(r): f"pipeline=reyes,shading_rate={r:g}" for r in RATES})
    curves.update({name_of_flatness(f): f"pipeline=reyes,shading_rate={DEFAULT_RATE:g},flatness={f:g}" for f in FLATNESS})
    return [parse_setting(f"{name}:{keys},device={device},threads={threads},max_depth=2") for name, keys in curves.items()]


def curves_of(family):
    if family == "shading rate":
        return [PATH, *map(name_of_rate, RATES)]
    return [PATH, name_of_rate(DEFAULT_RATE), *map(name_of_flatness, FLATNESS)]


def reference_of(name, references):
    """The reference of direct light."""
    return f"{name}_direct" if f"{name}_direct" in references else name


def scenes_of(folder, references):
    names = [path.stem.removesuffix("_patches") for path in sorted(folder.glob("*_patches.glb"))]
    return [name for name in names if reference_of(name, references) in references]


def error_at_samples(setting, spp, measure):
    return next((p[measure]["median"] for p in setting["points"] if p["spp"] == spp), None)


def seconds_at_samples(setting, spp):
    return next((p["render_seconds"] for p in setting["points"] if p["spp"] == spp), None)


def common_samples(document):
    """The largest number of samples that every curve has."""
    return min(s["points"][-1]["spp"] for s in document["settings"])


def table(documents, measure):
    """A row for each scene and curve: micropolygons of a picture, and at equal samples time and error."""
    lines = ["| scene | curve | micropolygons | samples | render | error | render and error beside path tracing |",
             "|---" * 7 + "|"]
    for name, document in documents.items():
        spp = common_samples(document)
        settings = {s["name"]: s for s in document["settings"]}
        path_seconds = seconds_at_samples(settings[PATH], spp)
        path_error = error_at_samples(settings[PATH], spp, measure)
        for setting in document["settings"]:
            seconds, error = seconds_at_samples(setting, spp), error_at_samples(setting, spp, measure)
            count = setting["micropolygons"]
            lines.append(f"| {name} | {setting['name']} | {'' if count is None else f'{count:,}'} | {spp} | "
                         f"{format_seconds(seconds)} | {error:.2e} | {seconds / path_seconds:.2f}, {error / path_error:.2f} |")
    return "\n".join(lines)


def styles_of(family):
    """Path tracing is black; a family goes from fine to coarse, light to dark, with the default in its own colour."""
    from matplotlib import colormaps
    names = curves_of(family)
    shades = colormaps["viridis_r" if family == "shading rate" else "plasma_r"]
    styles = {PATH: {"color": "#000000", "linestyle": "--", "marker": "x"}}
    for i, name in enumerate(names[1:]):
        styles[name] = {"color": shades(0.2 + 0.75 * i / (len(names) - 2)), "linestyle": "-", "marker": MARKERS[i]}
    return styles


def draw(documents, measure, path):
    """A row of panels for each family, a column for each scene."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter
    figure = Figure(figsize=(2.9 * len(documents) + 1.6, 5.8))
    panels = figure.subplots(len(FAMILIES), len(documents), squeeze=False, sharex="col", sharey="col")
    for row, family in enumerate(FAMILIES):
        styles = styles_of(family)
        for axes, (name, document) in zip(panels[row], documents.items()):
            settings = {s["name"]: s for s in document["settings"]}
            for curve in curves_of(family):
                points = [(p["render_seconds"], p[measure]["median"]) for p in settings[curve]["points"]
                          if p[measure]["median"] > 0]
                label = f"{curve}, default" if curve == name_of_rate(DEFAULT_RATE) else curve
                axes.loglog(*zip(*points), markersize=3.5, linewidth=1.3, label=label, **styles[curve])
            if row == 0:
                axes.set_title(name, fontsize=9, loc="left")
            axes.xaxis.set_major_locator(LogLocator(subs=(1,)))
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.yaxis.set_minor_formatter(NullFormatter())
            axes.grid(True, color="#e8e8e8", linewidth=0.6)
            axes.tick_params(labelsize=7)
            if row == len(FAMILIES) - 1:
                axes.set_xlabel("seconds of rendering", fontsize=8)
        handles, labels = panels[row][0].get_legend_handles_labels()
        panels[row][-1].legend(handles, labels, loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=8, frameon=False,
                               title=family, title_fontsize=8.5, alignment="left")
    figure.supylabel("relMSE" if measure == "relmse" else "relMSE, trimmed", fontsize=9)
    figure.tight_layout(rect=(0.01, 0, 1, 1))
    figure.savefig(path, dpi=110)


def main(arguments=None):
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("folder", type=pathlib.Path, metavar="SCENES")
    p.add_argument("names", nargs="*", metavar="NAME", help="default: all that have patches and a reference")
    p.add_argument("-o", "--output", type=pathlib.Path, required=True)
    p.add_argument("--seconds", type=float, default=10, help="of rendering for each curve and seed (default 10)")
    p.add_argument("--repeats", type=int, default=1, help="seeds (default 1)")
    p.add_argument("--max-spp", type=int, default=1024, help="most samples per pixel (default 1024)")
    p.add_argument("--device", default="cpu", help="default cpu")
    p.add_argument("--threads", type=int, default=0, help="of the CPU device (default: all)")
    p.add_argument("--processor-time", action="store_true",
                   help="of all threads of the process, rather than by the clock: where others use the machine")
    options = p.parse_args(arguments)
    index = options.folder / "reference" / "references.json"
    references = json.loads(index.read_text(encoding="utf-8"))
    known = scenes_of(options.folder, references)
    names = options.names or known
    unknown = [n for n in names if n not in known]
    if unknown:
        sys.exit(f"error: {options.folder} has no patches and reference of {', '.join(unknown)}; it has {', '.join(known)}")
    options.output.mkdir(parents=True, exist_ok=True)
    documents = {}
    for name in names:
        print(f"== {name}", flush=True)
        path = index.parent / f"{reference_of(name, references)}.exr"
        reference, noise = metrics.read_exr(path), parse_noise(str(index), str(path))
        limits = Limits(options.seconds, options.max_spp, options.repeats, seed=1,
                        clock=time.process_time if options.processor_time else time.perf_counter)
        curves = measure_curves(settings_of(options.device, options.threads), str(options.folder / f"{name}_patches.glb"),
                                reference, noise, limits, 0, lambda line: print(line, flush=True))
        results = [summarise(curve) for curve in curves]
        documents[name] = {
            "gpurt": gpurt.__version__, "device": curves[0].device.name, "threads": curves[0].resolved["num_threads"],
            "width": reference.shape[1], "height": reference.shape[0], "repeats": options.repeats,
            "reference_noise": dataclasses.asdict(noise),
            "settings": [{"name": r.name, "load_seconds": r.load_seconds, "build_seconds": r.build_seconds,
                          "micropolygons": r.curve.resolved.get("micropolygons"),
                          "points": [dataclasses.asdict(p) for p in r.points]} for r in results]}
    text = table(documents, "trimmed")
    (options.output / "reyes.md").write_text(text + "\n", encoding="utf-8")
    (options.output / "reyes.json").write_text(json.dumps(documents, indent=1) + "\n", encoding="utf-8")
    draw(documents, "trimmed", options.output / "reyes.png")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
