#!/usr/bin/env python3
"""Compares gpurt with Mitsuba 3's path tracer: time x error on the same scenes, threads and machine, in one run.

    mitsuba.py SCENE.glb ... --references DIR --shared DIR [--device cpu|cuda] [--threads N] [--seconds 5]
               [--runs 3] [--json OUT] [--pipeline path|photon]

For each scene both renderers first find the number of samples that takes at least --seconds; this also warms them
up, kernels compiled. Then they take turns, --runs times, with fresh seeds. A run's score is its seconds times its
trimmed relMSE (without the worst 0.1 % of the pixels) against the reference: error falls as 1 / time, so the score is
the time that an error of 1 would take, and half the score is twice the speed at equal error. (Of photon mapping it falls
more slowly, so its score holds for times about --seconds.) Loading, building and
compiling are reported apart. The ratio is gpurt / Mitsuba, of each turn, then the median: below 1 gpurt is faster.

The reference of NAME.glb and NAME_tess.glb is DIR/NAME.exr; its own noise, if references.json beside it tells it, is
subtracted. --shared names a folder with mitsuba_scene.py, which makes Mitsuba scenes of .glb files.

Needs gpurt (installed, or PYTHONPATH=build/python), mitsuba, numpy and OpenEXR. Mitsuba's fast CPU variant needs
LLVM's shared library (Debian: libllvm19); without it the scalar variant is used and named.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import os
import pathlib
import statistics
import sys
import tempfile
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

# This file has the name of the package that it imports.
sys.path[:] = [p for p in sys.path if os.path.realpath(p or ".") != os.path.dirname(os.path.realpath(__file__))]

import numpy as np

import gpurt
from gpurt import metrics

Render = Callable[[int, int], Tuple[float, np.ndarray]]  # samples per pixel and seed to seconds and picture


@dataclasses.dataclass
class Peer:
    name: str
    render: Render
    prepare_seconds: float  #: loading and building
    spp: int = 1
    warm_up_seconds: float = 0.0
    runs: List[Dict[str, float]] = dataclasses.field(default_factory=list)

    def find_samples(self, seconds: float) -> None:
        """Doubles the samples, and more where it is clear, until a render takes `seconds`."""
        start = time.perf_counter()
        while True:
            taken, _ = self.render(self.spp, 1)
            if taken >= seconds:
                break
            # A first render also compiles, so its rate is a lower bound.
            self.spp = max(2 * self.spp, int(self.spp * min(1.15 * seconds / taken, 16)))
        self.warm_up_seconds = time.perf_counter() - start

    def run(self, least_seconds: float, seed: int, reference: np.ndarray, noise: Dict[str, float]) -> None:
        seconds, picture = self.render(self.spp, seed)
        while seconds < least_seconds:  # the machine has become faster
            self.spp = int(self.spp * 1.15 * least_seconds / seconds) + 1
            seconds, picture = self.render(self.spp, seed)
        errors = metrics.compare(picture, reference, noise.get("relmse", 0.0), noise.get("relmse_trimmed", 0.0))
        self.runs.append({"spp": self.spp, "seconds": seconds, "score": seconds * errors.trimmed, **errors._asdict()})

    def median(self, key: str) -> float:
        return statistics.median(run[key] for run in self.runs)


def gpurt_peer(path: pathlib.Path, device: gpurt.Device, accel: str, pipeline: str, max_depth: int,
               size: Tuple[int, int]) -> Peer:
    start = time.perf_counter()
    scene = gpurt.load(path, device).commit(accel)
    prepare = time.perf_counter() - start

    def render(spp: int, seed: int) -> Tuple[float, np.ndarray]:
        start = time.perf_counter()
        image = scene.render(pipeline, width=size[0], height=size[1], spp=spp, seed=seed, max_depth=max_depth)
        return time.perf_counter() - start, image.color

    return Peer("gpurt" if pipeline == "path" else f"gpurt {pipeline}", render, prepare)


def mitsuba_peer(mi: Any, load_scene: Any, path: pathlib.Path, max_depth: int, size: Tuple[int, int]) -> Peer:
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        description, width, height = load_scene(mi, str(path), folder)
        scene = mi.load_dict(description)
    prepare = time.perf_counter() - start
    if (width, height) != size:
        raise ValueError(f"{path}: is {width}x{height}, its reference {size[0]}x{size[1]}")
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth, "hide_emitters": False})

    def render(spp: int, seed: int) -> Tuple[float, np.ndarray]:
        start = time.perf_counter()
        picture = np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed))[..., :3]
        return time.perf_counter() - start, picture

    return Peer("mitsuba", render, prepare)


def choose_variant(wanted: Optional[str], device: str, threads: int) -> Any:
    """Mitsuba with a variant that works here and as many threads as gpurt."""
    try:
        import mitsuba as mi
    except ImportError:
        sys.exit("mitsuba.py: Mitsuba 3 is missing: pip install mitsuba")
    variants = [wanted] if wanted else ["cuda_ad_rgb"] if device == "cuda" else ["llvm_ad_rgb", "scalar_rgb"]
    for variant in variants:
        try:
            mi.set_variant(variant)
            import drjit as dr
            if variant.startswith("llvm"):
                dr.eval(mi.Float(0) + 1)  # the library is loaded at the first use only
            break
        except Exception as error:
            print(f"mitsuba.py: no {variant}: {str(error).strip().splitlines()[0]}", file=sys.stderr)
    else:
        sys.exit("mitsuba.py: none of Mitsuba's variants works here")
    # Both thread pools, whichever the variant uses.
    dr.set_thread_count(threads)
    return mi


def import_scene_loader(shared: pathlib.Path) -> Any:
    for file in (shared / "tools" / "mitsuba_scene.py", shared / "mitsuba_scene.py"):
        if file.exists():
            spec = importlib.util.spec_from_file_location("mitsuba_scene", file)
            assert spec and spec.loader
            module = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(module)
            return module.load
    sys.exit(f"mitsuba.py: no mitsuba_scene.py in {shared}")


def compare_scene(path: pathlib.Path, peers: List[Peer], reference: np.ndarray, noise: Dict[str, float],
                  options: argparse.Namespace) -> Dict[str, Any]:
    for peer in peers:
        peer.find_samples(options.seconds)
    for turn in range(options.runs):
        for peer in peers:
            peer.run(options.seconds, options.seed + turn, reference, noise)
    ours, theirs = peers
    ratios = [a["score"] / b["score"] for a, b in zip(ours.runs, theirs.runs)]
    ratio = statistics.median(ratios)
    for peer in peers:
        print(f"{path.stem:20s} {peer.name:12s} {peer.spp:6d} spp {peer.median('seconds'):7.2f} s  relMSE "
              f"{peer.median('relmse'):.3e}  trimmed {peer.median('trimmed'):.3e}  score {peer.median('score'):.4e}",
              flush=True)
    print(f"{path.stem:20s} ratio gpurt / mitsuba {ratio:.3f} ({min(ratios):.3f} to {max(ratios):.3f})", flush=True)
    return {
        "scene": path.stem, "ratio": ratio, "ratios": ratios, "reference_noise": noise,
        "peers": {p.name: {"spp": p.spp, "prepare_seconds": p.prepare_seconds, "warm_up_seconds": p.warm_up_seconds,
                           **{k: p.median(k) for k in ("seconds", "relmse", "trimmed", "bias", "score")},
                           "runs": p.runs} for p in peers},
    }


def parse(arguments: Optional[List[str]]) -> argparse.Namespace:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("scenes", nargs="+", type=pathlib.Path)
    p.add_argument("--references", type=pathlib.Path, help="folder of NAME.exr (default: reference/ beside the scene)")
    p.add_argument("--shared", type=pathlib.Path, required=True, help="folder with (tools/)mitsuba_scene.py")
    p.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    p.add_argument("--accel", default="auto", help="of gpurt (default auto)")
    p.add_argument("--pipeline", choices=("path", "photon"), default="path", help="of gpurt (default path)")
    p.add_argument("--variant", help="of Mitsuba (default: llvm_ad_rgb, else scalar_rgb; cuda_ad_rgb on a GPU)")
    p.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="of both (default: all)")
    p.add_argument("--seconds", type=float, default=5.0, help="the least that a run takes (default 5)")
    p.add_argument("--runs", type=int, default=3, help="turns (default 3)")
    p.add_argument("--seed", type=int, default=1000)
    p.add_argument("--max-depth", type=int, default=17)
    p.add_argument("--json", type=pathlib.Path)
    options = p.parse_args(arguments)
    if options.seconds <= 0 or options.runs < 1 or options.threads < 1:
        p.error("--seconds, --runs and --threads must be positive")
    return options


def main(arguments: Optional[List[str]] = None) -> int:
    options = parse(arguments)
    load_scene = import_scene_loader(options.shared)
    mi = choose_variant(options.variant, options.device, options.threads)
    device = gpurt.Device(options.device, threads=options.threads if options.device == "cpu" else 0)
    properties = device.properties
    print(f"gpurt {gpurt.__version__}, mitsuba {mi.__version__} {mi.variant()}, {properties.name}, "
          f"{options.threads} threads, load average {os.getloadavg()[0]:.1f}", flush=True)
    rows = []
    for path in options.scenes:
        name = path.stem[:-5] if path.stem.endswith("_tess") else path.stem
        folder = options.references or path.parent / "reference"
        if not (folder / f"{name}.exr").exists():
            print(f"{path.stem}: no reference {folder / name}.exr, left out", file=sys.stderr)
            continue
        reference = metrics.read_exr(folder / f"{name}.exr")
        notes = folder / "references.json"
        entry = json.loads(notes.read_text()).get(name, {}) if notes.exists() else {}
        noise = {k: entry[k] for k in ("relmse", "relmse_trimmed") if k in entry}
        size = (reference.shape[1], reference.shape[0])
        peers = [gpurt_peer(path, device, options.accel, options.pipeline, options.max_depth, size),
                 mitsuba_peer(mi, load_scene, path, options.max_depth, size)]
        rows.append(compare_scene(path, peers, reference, noise, options))
    if options.json:
        options.json.write_text(json.dumps({
            "gpurt": gpurt.__version__, "mitsuba": mi.__version__, "variant": mi.variant(),
            "device": dataclasses.asdict(properties), "threads": options.threads, "seconds": options.seconds,
            "max_depth": options.max_depth, "scenes": rows}, indent=1) + "\n")
    return 0 if rows else 1


if __name__ == "__main__":
    sys.exit(main())
