#!/usr/bin/env python3
"""Error of path-traced images over samples, against reference images, with the slope in log-log.

Usage: convergence.py SCENE.glb ... [--references DIR] [--points 64 256 1024 4096] [--accel embree] [--json OUT]

DIR (default: `reference` beside the first scene) holds NAME.exr and references.json with each reference's size, depth and
noise. A scene NAME_tess.glb or NAME_patches.glb belongs to NAME.exr. The reference's own noise is subtracted before the
slope of the trimmed relMSE (without the worst 0.1 % of pixels) is fitted. -1 is what independent samples give.
Needs the gpurt package, numpy and OpenEXR.
"""
from __future__ import annotations

import argparse
import json
import pathlib
import sys
from typing import Any, Callable

import numpy as np

import gpurt
from gpurt import metrics


def errors(image: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """relMSE, and the same without the worst 0.1 % of pixels."""
    e = np.sort(((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1).ravel())
    return float(e.mean()), float(e[: int(len(e) * 0.999)].mean())


def measure(path: pathlib.Path, references: pathlib.Path, facts: dict[str, Any], o: argparse.Namespace) -> list[dict[str, Any]]:
    name = path.stem.removesuffix("_tess").removesuffix("_patches")
    reference = metrics.read_exr(str(references / f"{name}.exr")).astype(np.float64)
    scene = gpurt.load(str(path)).commit(accel=o.accel)
    points = []
    for i, spp in enumerate(o.points):
        image = scene.render("path", width=facts["width"], height=facts["height"], spp=spp, seed=100 + i,
                             max_depth=facts["max_depth"])
        relmse, trimmed = errors(image.color.astype(np.float64), reference)
        s = image.statistics
        points.append({"spp": spp, "seconds": s.render_seconds, "relmse": relmse, "trimmed": trimmed,
                       "own_trimmed": max(trimmed - facts["relmse_trimmed"], 0.0), "estimated": s.estimated_error,
                       "bias": float(image.color.mean() / reference.mean() - 1),
                       "rays": s.num_camera_rays + s.num_bounce_rays + s.num_shadow_rays})
        print(f"{path.stem:26s} {spp:6d} spp {s.render_seconds:8.2f} s  relMSE {relmse:.3e}  trimmed {trimmed:.3e}  "
              f"mean {100 * points[-1]['bias']:+.3f} %  estimate {s.estimated_error:.3e}", flush=True)
    x = np.log([p["spp"] for p in points])
    y = np.log([max(p["own_trimmed"], 1e-12) for p in points])
    slope = float(np.polyfit(x, y, 1)[0])
    print(f"{path.stem:26s} slope {slope:.3f}", flush=True)
    return [{"scene": path.stem, "slope": slope, "points": points}]


def measure_scenes(p: argparse.ArgumentParser, measure: Callable[..., list[dict[str, Any]]]) -> int:
    """Calls measure(scene, references, facts, options) for each scene with a reference; adds what options all need."""
    p.add_argument("scenes", nargs="+", type=pathlib.Path)
    p.add_argument("--references", type=pathlib.Path)
    p.add_argument("--json", type=pathlib.Path)
    o = p.parse_args()
    references = o.references or o.scenes[0].parent / "reference"
    table = json.loads((references / "references.json").read_text())
    rows = []
    for scene in o.scenes:
        name = scene.stem.removesuffix("_tess").removesuffix("_patches")
        if name not in table:
            print(f"{scene.stem}: no reference, left out", file=sys.stderr)
            continue
        rows += measure(scene, references, table[name], o)
    if o.json:
        o.json.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--points", nargs="+", type=int, default=[64, 256, 1024, 4096])
    p.add_argument("--accel", default="auto")
    return measure_scenes(p, measure)


if __name__ == "__main__":
    sys.exit(main())
