"""Renders and times.

A run loads and commits the scene, then adds samples to one frame: 1, 2, 4, ... per pixel. Since a frame that goes on
has the same bits as one rendered at once, a run gives the whole curve of one seed for the cost of its last point.
"""

from __future__ import annotations

import dataclasses
import time
from typing import Any, Callable, Dict, List

import gpurt
from gpurt import metrics
from gpurt.chart.settings import Setting
from gpurt.metrics import Picture

Say = Callable[[str], None]


@dataclasses.dataclass
class Limits:
    seconds: float  #: of rendering, for each setting and seed
    max_spp: int
    repeats: int
    seed: int
    clock: Callable[[], float] = time.perf_counter  #: of renderings; time.process_time: of the processor


@dataclasses.dataclass
class Noise:
    """The reference's own error."""

    relmse: float = 0.0
    trimmed: float = 0.0


@dataclasses.dataclass
class Sample:
    """One picture of one run."""

    spp: int
    render_seconds: float
    relmse: float
    trimmed: float
    bias: float


@dataclasses.dataclass
class Run:
    seed: int
    load_seconds: float
    build_seconds: float
    samples: List[Sample]


@dataclasses.dataclass
class Curve:
    """All runs of one setting."""

    setting: Setting
    runs: List[Run]
    device: gpurt.DeviceProperties
    resolved: Dict[str, Any]


def load_and_commit(setting: Setting, device: gpurt.Device, scene_path: str) -> "tuple[gpurt.Scene, float, float]":
    start = time.perf_counter()
    scene = gpurt.load(scene_path, device)
    loaded = time.perf_counter()
    scene.commit(**setting.commit)
    return scene, loaded - start, time.perf_counter() - loaded


def make_frame(scene: gpurt.Scene, reference: Picture, seed: int, camera: int) -> gpurt.Frame:
    return gpurt.Frame(scene, width=reference.shape[1], height=reference.shape[0], seed=seed, camera=camera)


def measure_run(setting: Setting, device: gpurt.Device, scene_path: str, reference: Picture, noise: Noise,
                limits: Limits, seed: int, camera: int) -> "tuple[Run, Dict[str, Any]]":
    scene, load_seconds, build_seconds = load_and_commit(setting, device, scene_path)
    # Threads start, pages and kernels are loaded: once a process, so not the method's.
    make_frame(scene, reference, seed, camera).submit(spp=1, **setting.render).wait()
    frame = make_frame(scene, reference, seed, camera)
    run = Run(seed, load_seconds, build_seconds, [])
    spp, seconds = 1, 0.0
    while True:
        start = limits.clock()
        frame.submit(spp=spp, **setting.render).wait()
        seconds += limits.clock() - start
        errors = metrics.compare(frame.read("color"), reference, noise.relmse, noise.trimmed)
        run.samples.append(Sample(spp, seconds, *errors))
        # The next point doubles what there is.
        if 2 * seconds > limits.seconds or 2 * spp > limits.max_spp:
            break
        spp *= 2
    statistics = frame.statistics
    resolved = {key: getattr(statistics, key) for key in (
        "pipeline", "accel", "triangle_test", "max_depth", "tile_size", "num_threads", "width", "height", "reason",
        "reyes")}
    if statistics.reyes:
        # Every submit dices anew.
        resolved["micropolygons"] = round(statistics.reyes_counters["num_micropolygons"] / len(run.samples))
    return run, resolved


def measure(settings: List[Setting], scene_path: str, reference: Picture, noise: Noise, limits: Limits, camera: int,
            say: Say) -> List[Curve]:
    """Runs of the settings alternate, so that what else the machine does meets all of them."""
    devices = [setting.make_device() for setting in settings]
    curves = [Curve(setting, [], device.properties, {}) for setting, device in zip(settings, devices)]
    for repeat in range(limits.repeats):
        for curve, device in zip(curves, devices):
            run, curve.resolved = measure_run(curve.setting, device, scene_path, reference, noise, limits,
                                              limits.seed + repeat, camera)
            curve.runs.append(run)
            last = run.samples[-1]
            say(f"{curve.setting.name}, seed {run.seed}: load {run.load_seconds:.2f} s, build "
                f"{run.build_seconds:.2f} s, {last.spp} spp in {last.render_seconds:.2f} s, relMSE {last.relmse:.3g}, "
                f"trimmed {last.trimmed:.3g}")
    return curves


@dataclasses.dataclass
class TimedPicture:
    """A picture that took as long as the others'."""

    name: str
    spp: int
    seconds: float
    errors: metrics.Errors
    picture: Picture
    png: bytes


def render_picture(setting: Setting, scene_path: str, reference: Picture, noise: Noise, seconds: float, seed: int,
                   camera: int) -> TimedPicture:
    """In about `seconds`, load and build included; one sample a pixel takes as long as it takes."""
    scene, load_seconds, build_seconds = load_and_commit(setting, setting.make_device(), scene_path)
    make_frame(scene, reference, seed, camera).submit(spp=1, **setting.render).wait()  # as in measure_run
    frame = make_frame(scene, reference, seed, camera)
    start = time.perf_counter()
    frame.submit(time=max(seconds - load_seconds - build_seconds, 1e-6), **setting.render).wait()
    seconds = time.perf_counter() - start + load_seconds + build_seconds
    if frame.statistics.samples_per_pixel == 0:
        frame.submit(spp=1, **setting.render).wait()
        seconds = time.perf_counter() - start + load_seconds + build_seconds
    spp = frame.statistics.samples_per_pixel
    image = frame.image()
    errors = metrics.compare(image.color, reference, noise.relmse, noise.trimmed)
    return TimedPicture(setting.name, spp, seconds, errors, image.color, image._repr_png_())
