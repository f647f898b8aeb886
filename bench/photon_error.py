#!/usr/bin/env python3
"""How often photon mapping's true error lies within what it states, against reference images.

Usage: photon_error.py SCENE.glb ... [--references DIR] [--points 32 128 512] [--estimator memoryless] [--device cpu]
                       [--json OUT]

DIR (default: `reference` beside the first scene) holds NAME.exr and references.json with each reference's size, depth and
noise. For each number of passes:

The reference's own error is allowed for.

  pixels   share of pixels and channels whose error is not above GPURT_OUTPUT_ERROR
  tiles    share of tiles of 8 x 8 pixels whose root-mean-square error is not above that of GPURT_OUTPUT_ERROR
  means    share of those tiles whose mean error is not above the mean of GPURT_OUTPUT_ERROR
  ratio    median over tiles of stated over true root-mean-square error: how wide the bound is
  bias     correlation of GPURT_OUTPUT_BIAS and the true error, both as means of tiles
  relMSE   true, without the reference's own, and stated: of which bias
  mean     of the image, over the reference's
  slope    of the logarithm of the true relMSE over that of passes: as passes go on, -2/3 in theory

Needs the gpurt package, numpy and OpenEXR.
"""
from __future__ import annotations

import argparse
import pathlib
import sys
from typing import Any

import numpy as np

import gpurt
from convergence import measure_scenes
from gpurt import metrics


def tiles(values: np.ndarray) -> np.ndarray:
    """Means over tiles of 8 x 8 and channels; what is left over at the edges is left out."""
    h, w = values.shape[0] // 8 * 8, values.shape[1] // 8 * 8
    return values[:h, :w].reshape(h // 8, 8, w // 8, 8, -1).mean((1, 3, 4))


def measure(path: pathlib.Path, references: pathlib.Path, facts: dict[str, Any], o: argparse.Namespace) -> list[Any]:
    name = path.stem.removesuffix("_tess").removesuffix("_patches")
    reference = metrics.read_exr(str(references / f"{name}.exr")).astype(np.float64)
    scene = gpurt.load(str(path), device=gpurt.Device(o.device)).commit(accel="bvh")
    frame = gpurt.Frame(scene, width=facts["width"], height=facts["height"], seed=11,
                        outputs=("bias", "error", "variance"))
    rows = []
    for spp in o.points:
        with frame.submit("photon", spp=spp, max_depth=facts["max_depth"], photon={"estimator": o.estimator}) as job:
            job.wait()
        s = frame.statistics
        color, bias, bound = (frame.read(k).astype(np.float64) for k in ("color", "bias", "error"))
        error = color - reference
        # The reference's own noise, with two standard deviations.
        bound = np.sqrt(bound**2 + 4 * facts["relmse"] * (reference**2 + 0.01))
        stated, true = np.sqrt(tiles(bound**2)), np.sqrt(tiles(error**2))
        relmse = float((error**2 / (reference**2 + 0.01)).mean()) - facts["relmse"]
        row = {"scene": path.stem, "passes": spp, "pixels": float((np.abs(error) <= bound).mean()),
               "tiles": float((true <= stated).mean()), "means": float((np.abs(tiles(error)) <= tiles(bound)).mean()),
               "ratio": float(np.median(stated / np.maximum(true, 1e-30))),
               "bias": float(np.corrcoef(tiles(bias).ravel(), tiles(error).ravel())[0, 1]),
               "relmse": relmse, "stated": s.estimated_error, "stated_bias": s.estimated_bias,
               "mean": float(color.mean() / reference.mean() - 1), "radius": s.photon_counters["smallest_radius"], "seconds": s.render_seconds}
        rows.append(row)
        print(f"{path.stem:20s} {spp:5d} passes {s.render_seconds:7.1f} s  pixels {100 * row['pixels']:5.1f} %  "
              f"tiles {100 * row['tiles']:5.1f} %  means {100 * row['means']:5.1f} %  ratio {row['ratio']:4.1f}  "
              f"bias {row['bias']:+.2f}  relMSE {relmse:.2e} stated {s.estimated_error:.2e} "
              f"({s.estimated_bias:.2e} bias)  mean {100 * row['mean']:+.3f} %", flush=True)
    known = [(row["passes"], row["relmse"]) for row in rows if row["relmse"] > 0]
    if len(known) > 1:
        print(f"{path.stem:20s} slope {np.polyfit(*np.log(np.array(known).T), 1)[0]:.3f}", flush=True)
    return rows


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--points", nargs="+", type=int, default=[32, 128, 512])
    p.add_argument("--estimator", default="memoryless", choices=("memoryless", "adaptive"))
    p.add_argument("--device", default="auto")
    return measure_scenes(p, measure)


if __name__ == "__main__":
    sys.exit(main())
