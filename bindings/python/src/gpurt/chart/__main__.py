"""The command line of the chart."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import pathlib
import shlex
import sys
from typing import Any, Dict, List, Optional

import gpurt
from gpurt import metrics
from gpurt.chart.measure import Limits, Noise, TimedPicture, measure, render_picture
from gpurt.chart.settings import KEY_NAMES, default_settings, parse_setting

FILES = "chart.csv, chart.json, chart.svg, chart.png, index.html"


def missing_packages() -> List[str]:
    return [name for name in ("matplotlib", "OpenEXR") if importlib.util.find_spec(name) is None]


def parse_noise(text: str, reference: str) -> Noise:
    """A number, two (full and trimmed), or a JSON file that has both under the reference's name."""
    if text.endswith(".json"):
        entry = json.loads(pathlib.Path(text).read_text(encoding="utf-8")).get(pathlib.Path(reference).stem)
        if not isinstance(entry, dict) or "relmse" not in entry:
            raise ValueError(f"{text} has no entry for {pathlib.Path(reference).stem}")
        return Noise(float(entry["relmse"]), float(entry["relmse_trimmed" if "relmse_trimmed" in entry else "relmse"]))
    numbers = [float(part) for part in text.split(",")]
    if len(numbers) > 2 or min(numbers) < 0:
        raise ValueError("expected one number or two, not negative")
    return Noise(numbers[0], numbers[-1])


def make_parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        prog="python -m gpurt.chart", description="Charts error over time of rendering settings for one scene.",
        epilog=f"Writes {FILES}. Time includes loading and building; each point is the median over the seeds.")
    p.add_argument("scene", help="glTF file (.glb, .gltf)")
    p.add_argument("--reference", required=True, help="EXR file to compare with; it gives the size of the pictures")
    p.add_argument("-o", "--output", required=True, metavar="DIR", help="folder for the files; made if missing")
    p.add_argument("--settings", action="append", type=parse_setting, metavar="NAME:key=value,...",
                   help=f"one curve; may be repeated. Keys: {KEY_NAMES}. Default: path tracing, with both accelerators "
                        "on the CPU, and photon mapping, on --device")
    p.add_argument("--device", default="auto", help="of the default settings: auto, cpu or cuda[:N] (default auto: "
                                                    "the CPU, and the GPU if there is one)")
    p.add_argument("--reference-noise", metavar="E[,T]|FILE.json",
                   help="relMSE of the reference itself (and trimmed), which is subtracted, or a file that has them")
    p.add_argument("--seconds", type=float, default=10, help="of rendering for each setting and seed (default 10)")
    p.add_argument("--max-spp", type=int, default=65536, help="most samples per pixel (default 65536)")
    p.add_argument("--repeats", type=int, default=3, help="seeds for each setting (default 3)")
    p.add_argument("--seed", type=int, default=1, help="the first seed (default 1)")
    p.add_argument("--camera", type=int, default=0, help="of the scene (default 0)")
    p.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return p


def run(options: argparse.Namespace, command: str) -> None:
    say = (lambda text: None) if options.quiet else (lambda text: print(text, flush=True))
    reference = metrics.read_exr(options.reference)
    noise = parse_noise(options.reference_noise, options.reference) if options.reference_noise else Noise()
    settings = options.settings or default_settings(gpurt.devices(), options.device)
    names = [s.name for s in settings]
    if len(set(names)) < len(names):
        raise ValueError("--settings: two curves have the same name")
    os.makedirs(options.output, exist_ok=True)

    limits = Limits(options.seconds, options.max_spp, options.repeats, options.seed)
    curves = measure(settings, options.scene, reference, noise, limits, options.camera, say)
    write(options, command, reference, noise, curves, say)


def write(options: argparse.Namespace, command: str, reference: metrics.Picture, noise: Noise, curves: Any,
          say: Any) -> None:
    from gpurt.chart import analyse, draw, report
    results = [analyse.summarise(curve) for curve in curves]
    tables = analyse.tables(results)
    for r in results:
        for m in analyse.MEASURES:
            lost = sum(p.error(m).median <= 0 for p in r.points)
            if lost:
                say(f"{r.name}: {lost} points of {m} are below the reference's noise and left out of the chart")
        fits = ", ".join(f"{m} {f.slope:+.3f} ± {f.slope_error:.3f}" for m, f in r.fits.items() if f)
        say(f"{r.name}: slope of error over render time: {fits or 'needs two points'}")
    for m in analyse.MEASURES:
        for crossing in analyse.crossings(results, m):
            say(f"{m}: {report.crossing_text(crossing)}")

    # One more picture of each setting, in the time of the shortest curve.
    seconds = analyse.picture_seconds(results)
    pictures: List[TimedPicture] = [
        render_picture(r.curve.setting, options.scene, reference, noise, seconds,
                       options.seed + options.repeats, options.camera) for r in results]

    height, width = reference.shape[:2]
    scene = pathlib.Path(options.scene).stem
    title = f"{scene}: error over time"
    seeds = f"median of {options.repeats} seeds" if options.repeats > 1 else "one seed"
    subtitle = (f"{width}x{height} pixels, gpurt {gpurt.__version__}, "
                f"{'; '.join(dict.fromkeys(c.device.name for c in curves))}; {seeds}"
                + (", the reference's noise subtracted" if noise.relmse > 0 else ""))
    notes = ("Band: smallest to largest over the seeds. Grey: Pareto front. Rings: methods cross. Slope: of error over render time "
             "alone, later half; -1 is an unbiased method.")
    about: Dict[str, Any] = {
        "gpurt": gpurt.__version__, "command": command, "scene": options.scene, "reference": options.reference,
        "width": width, "height": height, "reference_noise": {"relmse": noise.relmse, "trimmed": noise.trimmed},
        "repeats": options.repeats, "seed": options.seed, "camera": options.camera,
    }
    folder = pathlib.Path(options.output)
    report.write_csv(str(folder / "chart.csv"), results)
    report.write_json(str(folder / "chart.json"), about, results, tables, pictures)
    figure = draw.draw(results, title, subtitle, notes)
    draw.save(figure, str(folder / "chart.png"), "png")
    draw.save(figure, str(folder / "chart.svg"), "svg")
    report.write_page(str(folder / "index.html"), title, command,
                      (folder / "chart.svg").read_text(encoding="utf-8"), results, tables, pictures, reference)
    say(f"wrote {FILES} to {folder}")


def main(arguments: Optional[List[str]] = None) -> int:
    parser = make_parser()
    options = parser.parse_args(arguments)
    if options.seconds <= 0 or options.max_spp < 1 or options.repeats < 1:
        parser.error("--seconds, --max-spp and --repeats must be positive")
    missing = missing_packages()
    if missing:
        print(f"error: the chart needs {' and '.join(missing)}: pip install 'gpurt[chart]'", file=sys.stderr)
        return 1
    command = shlex.join(["python", "-m", "gpurt.chart", *(sys.argv[1:] if arguments is None else arguments)])
    try:
        run(options, command)
    except (gpurt.Error, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
