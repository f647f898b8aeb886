"""Frames, which renders add samples to, and the jobs that do it."""

from __future__ import annotations

import dataclasses
import os
import time as clock
from types import TracebackType
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, NoReturn, Optional, Sequence, Tuple, Type

import numpy as np

from gpurt import _core
from gpurt._arrays import Array, PathLike, as_array, shape_text, to_count, to_number, to_path, to_uint32
from gpurt._callbacks import Callback, check_callable
from gpurt._names import (ACCEL, OUTPUT, PHOTON_ESTIMATOR, PHOTON_KERNEL, PHOTON_REMEDY, PIPELINE, REYES_FILTER,
                          REYES_SHADING, SCHEDULE, TRIANGLE_TEST)
from gpurt.device import refuse_pickling
from gpurt.errors import Cancelled, Error, InvalidArgument, Timeout

if TYPE_CHECKING:
    from gpurt.image import Image
    from gpurt.scene import Scene

# Numbers of a pixel and their type, for each output.
_OUTPUT_SHAPE = {
    "color": (3, np.float32), "alpha": (0, np.float32), "depth": (0, np.float32), "normal": (3, np.float32),
    "albedo": (3, np.float32), "position": (3, np.float32), "primitive": (0, np.uint32), "instance": (0, np.uint32),
    "sample_count": (0, np.uint32), "variance": (3, np.float32), "time": (0, np.float32), "bias": (3, np.float32),
    "error": (3, np.float32),
}
# Kept by every frame.
_ALWAYS = ("color", "alpha", "sample_count")

# How long a wait goes without a look at signals and callbacks, in seconds.
_SLICE = 0.05


@dataclasses.dataclass(frozen=True)
class Statistics:
    """What a frame took, and the settings that zeros and "auto" became."""

    pipeline: str
    accel: str
    triangle_test: str
    max_depth: int
    tile_size: int
    num_threads: int
    width: int
    height: int
    seed: int
    samples_per_pixel: int  #: the smallest number that a pixel of the frame has
    num_samples: int  #: camera paths, like the rest over all jobs of the frame
    num_camera_rays: int
    num_bounce_rays: int
    num_shadow_rays: int
    num_nonfinite: int  #: samples that were not finite and left out; 0 in a sound scene
    num_saturated: int  #: sums that left the film's range; not 0 makes the job fail
    render_seconds: float
    generate_seconds: float  #: this and the next four: per stage, summed over threads
    trace_seconds: float
    shade_seconds: float
    shadow_seconds: float
    film_seconds: float
    build_seconds: float  #: of the scene's commit
    estimated_error: float  #: relMSE of the frame, noise and known bias; negative: not known
    estimated_bias: float  #: the part of it that is bias; negative: not known
    largest_sample: float  #: largest radiance of a single sample
    memory_peak: int  #: bytes
    reason: str  #: why settings were chosen
    schedule: Dict[str, Any]  #: how the device went about it, as submit() takes it
    schedule_counters: Dict[str, int]  #: what schedules did
    photon: Dict[str, Any]  #: settings of photon mapping, resolved, as submit() takes them; empty for other pipelines
    photon_counters: Dict[str, float]  #: what photon mapping did
    reyes: Dict[str, Any]  #: settings of REYES, resolved, as submit() takes them; empty for other pipelines
    reyes_counters: Dict[str, float]  #: what REYES did


def _schedule_values(schedule: Optional[Mapping[str, Any]]) -> List[int]:
    """As gpurt_schedule has them, ray_budget last."""
    given = dict(schedule or {})
    values = [names.value(given.pop(field, "auto")) for field, names in SCHEDULE.items()]
    values.append(to_count(given.pop("ray_budget", 0), "ray_budget", 64))
    if given:
        raise InvalidArgument(f"schedule: {next(iter(given))!r} is none of "
                              f"{', '.join(map(repr, (*SCHEDULE, 'ray_budget')))}")
    return values


_REMEDY_BITS = (1, 2, 4, 8, 32)  # of PHOTON_REMEDY
_NO_REMEDY = 16  # GPURT_PHOTON_REMEDY_NONE


def _photon_values(photon: Optional[Mapping[str, Any]]) -> Tuple[int, float, int, int, int]:
    """photons_per_pass, initial_radius, estimator, kernel and remedies of gpurt_photon_settings."""
    given = dict(photon or {})
    count = to_count(given.pop("photons_per_pass", 0), "photons_per_pass")
    radius = to_number(given.pop("initial_radius", 0), "initial_radius")
    estimator = PHOTON_ESTIMATOR.value(given.pop("estimator", "auto"))
    kernel = PHOTON_KERNEL.value(given.pop("kernel", "auto"))
    remedies = given.pop("remedies", None)
    bits = 0
    if remedies is not None:
        for name in (remedies,) if isinstance(remedies, str) else remedies:
            bits |= _REMEDY_BITS[PHOTON_REMEDY.value(name)]
        bits = bits or _NO_REMEDY
    if given:
        raise InvalidArgument(f"photon: {next(iter(given))!r} is none of 'photons_per_pass', 'initial_radius', "
                              "'estimator', 'kernel', 'remedies'")
    return count, radius, estimator, kernel, bits


def _photon_names(values: Mapping[str, Any]) -> Dict[str, Any]:
    """What submit() takes, from gpurt_photon_settings."""
    if not values["photons_per_pass"]:
        return {}
    remedies = tuple(name for name, bit in zip(PHOTON_REMEDY.names, _REMEDY_BITS) if values["remedies"] & bit)
    return {**values, "estimator": PHOTON_ESTIMATOR.name(values["estimator"]),
            "kernel": PHOTON_KERNEL.name(values["kernel"]), "remedies": remedies}


def _reyes_values(reyes: Optional[Mapping[str, Any]]) -> Tuple[float, int, int, int, float, int]:
    """shading_rate, filter, shading, no_shadows, flatness and fragment_slots of gpurt_reyes_settings."""
    given = dict(reyes or {})
    rate = to_number(given.pop("shading_rate", 0), "shading_rate")
    pixel_filter = REYES_FILTER.value(given.pop("filter", "auto"))
    shading = REYES_SHADING.value(given.pop("shading", "auto"))
    shadows = given.pop("shadows", True)
    flatness = to_number(given.pop("flatness", 0), "flatness")
    slots = to_count(given.pop("fragment_slots", 0), "fragment_slots")
    if given:
        raise InvalidArgument(f"reyes: {next(iter(given))!r} is none of 'shading_rate', 'filter', 'shading', 'shadows', "
                              "'flatness', 'fragment_slots'")
    return rate, pixel_filter, shading, 0 if shadows else 1, flatness, slots


def _reyes_names(values: Mapping[str, Any]) -> Dict[str, Any]:
    """What submit() takes, from gpurt_reyes_settings."""
    if not values["shading_rate"]:
        return {}
    return {**values, "filter": REYES_FILTER.name(values["filter"]), "shading": REYES_SHADING.name(values["shading"])}


class Frame:
    """The film of a committed scene: renders add samples to it, in any number of jobs.

    :param scene: committed; it is kept alive.
    :param width, height: pixels; 0: what the camera says, else 512.
    :param camera: of the scene, from 0.
    :param outputs: what to keep beside color, alpha and sample_count, which every frame has: depth, normal, albedo,
        position, primitive, instance, variance; of photon mapping bias and error.
    :param seed: of the random numbers.
    :param frame_index: of an animation: decorrelates the samples of different frames.
    :param first_sample: the first sample index that this frame renders; frames with other ranges can be merged.

    Row 0 is the top row; a value is the mean over the square of its pixel. Frames can be used from several threads.

    Raises InvalidArgument, OutOfMemory, Unsupported.
    """

    def __init__(self, scene: "Scene", *, width: int = 0, height: int = 0, camera: int = 0,
                 outputs: Sequence[str] = (), seed: int = 0, frame_index: int = 0, first_sample: int = 0) -> None:
        if isinstance(outputs, str):
            outputs = (outputs,)
        bits = 0
        for name in outputs:
            bits |= 1 << OUTPUT.value(name, "outputs")
        self.scene = scene
        self._core = _core.Frame(scene._core, to_count(width, "width"), to_count(height, "height"),
                                 to_count(camera, "camera"), bits, to_count(frame_index, "frame_index"),
                                 to_count(seed, "seed", 64), to_count(first_sample, "first_sample", 64))
        #: Names of the outputs that read() has.
        self.outputs: Tuple[str, ...] = tuple(n for i, n in enumerate(OUTPUT.names) if n in _ALWAYS or bits >> i & 1)
        statistics = self.statistics
        self.width, self.height = statistics.width, statistics.height

    def submit(self, pipeline: str = "auto", *, spp: int = 0, error: float = 0, time: float = 0, max_depth: int = 0,
               tile_size: int = 0, tiles: Any = None,
               progress: Optional[Callable[[float, float], Any]] = None,
               schedule: Optional[Mapping[str, Any]] = None,
               photon: Optional[Mapping[str, Any]] = None,
               reyes: Optional[Mapping[str, Any]] = None) -> "Job":
        """Starts rendering and returns at once.

        :param pipeline: "auto", "path", "photon", "reyes" or "hybrid".
        :param spp: until every pixel of the tiles has this many samples; 0: by error or time, else 64.
        :param error: stop at the first whole-frame pass whose estimated relMSE, with its bias, is below; 0: none.
        :param time: seconds: stop at the last whole-frame pass that fits; 0: none.
        :param max_depth: of paths: emission seen directly is 1, direct light 2; 0: 17.
        :param tile_size: edge of the square work unit in pixels; 0: the library's choice; changes no bits.
        :param tiles: rectangles x0 y0 x1 y1, [n][4], of the pixels with x0 <= x < x1; None: the whole frame.
        :param progress: called now and then as progress(done, total) in samples, from another thread, never from
            two at once. It must not use gpurt. If it raises, the job is cancelled and waiting raises the same.
        :param schedule: how a CUDA device goes about it; changes no bits. By name: traversal ("stack", "leaf_lists",
            "uber"), launch ("regular", "persistent", "rounds"), fetch ("per_thread", "packets"), compaction
            ("block_scan", "pyramid", "naive_scan", "library_scan"), shading ("immediate", "sorted"), generation ("slots",
            "counted", "refilled"), ray_budget. What is left out is "auto", the library's choice.
        :param photon: settings of the pipeline "photon", by name: photons_per_pass, initial_radius (metres), estimator
            ("memoryless", "per_pixel", "adaptive"), kernel ("constant", "cone"), remedies (any of "normal", "plane",
            "side", "boundary", "continue"; () for none). What is left out is the library's choice, with a
            time by trial passes, or what the frame's samples were made with.
        :param reyes: settings of the pipeline "reyes", by name: shading_rate (the area of a micropolygon in pixels),
            filter ("box", "gaussian", "mitchell"), shading ("samples", "micropolygons", "blocks"), shadows (False:
            nothing stands between a surface and a light), flatness (> 0: micropolygons may be larger, with
            edges of up to 2.8 pixels, where they stay within so many pixels of the surface), fragment_slots (a study variant: of surfaces that blend
            a sample keeps the nearest, so many; 0: all). As for photon.

        Samples are added to what the frame has: a job that was cancelled, or stopped early, goes on where it was,
        and the image has the same bits as if it had run at once. Jobs of one frame run one after another. A job
        that is dropped while it runs is cancelled.

        Raises InvalidArgument, Unsupported, OutOfMemory.
        """
        check_callable(progress, "progress")
        rectangles = None
        if tiles is not None:
            rectangles = to_uint32(as_array(tiles, "tiles"), "tiles")
            if rectangles.ndim != 2 or rectangles.shape[1] != 4 or len(rectangles) == 0:
                raise InvalidArgument(f"tiles: expected [n][4] = x0 y0 x1 y1, got {shape_text(rectangles.shape)}")
            rectangles = np.ascontiguousarray(rectangles)
        callback = None if progress is None else Callback(progress)
        with self.scene.device._log_errors():
            job = self._core.submit(PIPELINE.value(pipeline), to_count(spp, "spp"), to_number(error, "error"),
                                    to_number(time, "time"), to_count(max_depth, "max_depth"),
                                    to_count(tile_size, "tile_size"), rectangles, callback,
                                    _schedule_values(schedule), _photon_values(photon), _reyes_values(reyes))
        return Job(self, job, callback)

    def read(self, output: str = "color") -> Array:
        """Copies an output out: float32 [h][w][3] for color, normal, albedo, position, variance, bias and error,
        float32 [h][w] for alpha and depth, uint32 [h][w] for primitive, instance and sample_count.

        Pixels without samples are 0. May be called while a job runs: whole samples are seen.
        """
        index = OUTPUT.value(output, "output")
        channels, dtype = _OUTPUT_SHAPE[output]
        shape = (self.height, self.width, channels) if channels else (self.height, self.width)
        data: Array = np.empty(shape, dtype)
        self._core.read(index, data)
        return data

    def image(self) -> "Image":
        """The frame as it is now."""
        from gpurt.image import Image
        return Image(self)

    @property
    def statistics(self) -> Statistics:
        """What the frame took; while a job runs, of what is done so far."""
        values = self._core.statistics()
        return Statistics(**{**values, "pipeline": PIPELINE.name(values["pipeline"]),
                             "accel": ACCEL.name(values["accel"]),
                             "triangle_test": TRIANGLE_TEST.name(values["triangle_test"]),
                             "schedule": {field: SCHEDULE[field].name(value) if field in SCHEDULE else value
                                          for field, value in values["schedule"].items()},
                             "photon": _photon_names(values["photon"]),
                             "reyes": _reyes_names(values["reyes"])})

    def save(self, path: PathLike) -> None:
        """Writes the frame to a file, by its extension.

        .exr: float32, every output as a named layer, settings and seed in the header. .png: the colour, tonemapped
        with x / (1 + x) and the sRGB curve. .gpurt: the frame's sums, exact, for load_state() and merging elsewhere.

        Raises InvalidArgument for another extension; FileError.
        """
        with self.scene.device._log_errors():
            self._core.save(to_path(path))

    def merge(self, other: "Frame") -> None:
        """Adds the samples of another frame; any order of merging gives the same bits as rendering at once.

        Raises InvalidArgument where scenes, sizes, seeds, outputs or settings differ, or samples would count twice.
        """
        if not isinstance(other, Frame):
            raise TypeError(f"other: expected a gpurt.Frame, got {type(other).__name__}")
        self._core.merge(other._core)

    def load_state(self, path: PathLike) -> None:
        """Adds the samples of a .gpurt file. Raises as merge(); FileError for a missing or damaged file."""
        self._core.load_state(to_path(path))

    def __repr__(self) -> str:
        return f"<gpurt.Frame {self.width}x{self.height}, {self.statistics.samples_per_pixel} samples per pixel>"

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.Frame", "save() it as .gpurt and load_state() it there")


class Job:
    """Rendering that was submitted.

    As a context manager it waits at the end of the block, and an exception in the block cancels it:

        with frame.submit(spp=256) as job:
            while not job.done: ...
    """

    def __init__(self, frame: Frame, core: _core.Job, callback: Optional[Callback]) -> None:
        self.frame = frame
        self._core = core
        self._callback = callback

    def wait(self, timeout: Optional[float] = None) -> None:
        """Waits for the end of the job, at most `timeout` seconds.

        Ctrl-C cancels the job; the frame keeps the whole samples that were done.

        Raises Timeout if it still runs; Cancelled if it was cancelled; what the progress function raised; the
        job's own failure.
        """
        if timeout is not None:
            timeout = to_number(timeout, "timeout")
        deadline = None if timeout is None else clock.monotonic() + timeout
        try:
            with self.frame.scene.device._log_errors():
                while not self._poll(deadline):
                    if self._failed() is not None:
                        break
                    if deadline is not None and clock.monotonic() >= deadline:
                        raise Timeout(f"the job still runs after {timeout:g} s; wait longer, or cancel() it")
        except Error:
            # A job that was cancelled for its progress function's sake ends with that function's error.
            if self._failed() is None:
                raise
        except BaseException:
            self._stop()
            raise
        error = self._failed()
        if error is not None:
            self._stop()
            raise error

    def _poll(self, deadline: Optional[float]) -> bool:
        left = _SLICE if deadline is None else min(_SLICE, max(0.0, deadline - clock.monotonic()))
        return self._core.wait(int(left * 1e9))

    def _failed(self) -> Optional[BaseException]:
        return None if self._callback is None else self._callback.error

    def _stop(self) -> None:
        """Cancels and waits for the end, however that is."""
        self._core.cancel()
        try:
            while not self._core.wait(int(_SLICE * 1e9)):
                pass
        except Error:
            pass

    def cancel(self) -> None:
        """Asks the job to stop, which it does within half a second, keeping whole samples."""
        self._core.cancel()

    @property
    def done(self) -> bool:
        """Whether the job has ended, well or not: then wait() returns, or raises, at once."""
        if self._failed() is not None:
            self._core.cancel()
        try:
            return self._core.wait(0)
        except Error:
            return True

    @property
    def progress(self) -> float:
        """Share of the job that is done, in [0, 1]."""
        return self._core.progress()

    def __enter__(self) -> "Job":
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], error: Optional[BaseException],
                 trace: Optional[TracebackType]) -> None:
        if kind is None:
            self.wait()
        else:
            self._stop()

    def __repr__(self) -> str:
        return f"<gpurt.Job {'ended' if self.done else f'running, {self.progress:.0%} done'}>"

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.Job", "wait for it and send the image")
