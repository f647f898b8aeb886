"""Photon maps: points in space, found by where they are."""

from __future__ import annotations

import dataclasses
from typing import Any, List, NoReturn, Optional, Tuple

import numpy as np

from gpurt import _core
from gpurt._arrays import PathLike, float_rows, shape_text, to_count, to_number, to_path
from gpurt._foreign import _check_place, _is_on_gpu, _ready_view
from gpurt._libraries import Library, library_of
from gpurt._memory import DEFAULT_STREAM, DeviceArray, View
from gpurt._names import GATHER_KERNEL, GATHER_METHOD, PHOTON_ATTRIBUTE, PHOTON_QUERY
from gpurt._trace import slices
from gpurt.device import Device, default_device, refuse_pickling
from gpurt.errors import InvalidArgument


@dataclasses.dataclass(frozen=True)
class PhotonMapInfo:
    """What a photon map is."""

    num_points: int
    num_levels: int  #: grids, each with cells 4 times larger than the one before
    bounds_min: Tuple[float, float, float]
    bounds_max: Tuple[float, float, float]
    radius: float  #: that was asked for, or chosen
    has_fluxes: bool
    has_normals: bool
    fullest_cell: int  #: points of the fullest entry of the finest grid's table
    memory_bytes: int
    build_seconds: float
    has_directions: bool  #: of flight: maps of Scene.trace_photons() have them
    num_paths: int  #: photons that left the lights for it; 0: the points are the caller's


class _Rows:
    """float32 [...][3], on a GPU where they lie, else as numpy has them."""

    def __init__(self, device: Device, value: Any, name: str, stream: Optional[int] = DEFAULT_STREAM) -> None:
        self.library = library_of(value)
        self.on_gpu = self.library is not None and _is_on_gpu(value)
        self.like = value
        if self.on_gpu:
            assert self.library is not None
            _check_place(device, value, name, self.library)
            self.view: Optional[View] = _ready_view(device, value, name, stream)
            if not self.view.shape or self.view.shape[-1] != 3:
                raise self.view.refuse("expected [...][3]", "change its shape")
            if self.view.dtype != "float32":
                raise self.view.refuse("expected float32", self.library.to_float32)
            if not self.view.is_packed():
                raise self.view.refuse(f"expected rows without gaps, not strides {self.view.strides}",
                                       self.library.to_packed)
            self.shape, self.data = tuple(self.view.shape[:-1]), self.view.data
        else:
            shape = tuple(getattr(value, "shape", None) or np.shape(value))
            rows = float_rows(np.reshape(value, (-1, 3)) if shape == (3,) else value, name, 3, "[...][3]")
            self.rows = np.ascontiguousarray(rows)
            self.shape, self.data = (shape[:-1] if len(shape) > 1 or shape == (3,) else (0,)), self.rows.ctypes.data
        self.count = 1
        for n in self.shape:
            self.count *= n


class _Batch:
    """Queries of one call: where their answers go, and how they are asked."""

    def __init__(self, photons: "PhotonMap", positions: Any, normals: Any, min_cosine: float) -> None:
        self.photons = photons
        device = photons.device
        library = library_of(positions)
        self.on_gpu = library is not None and _is_on_gpu(positions)
        self.library = library if library is not None and self.on_gpu else Library()
        self.stream = self.library.stream(positions) if self.on_gpu else None
        self.positions = _Rows(device, positions, "positions", self.stream)
        self.normals = None if normals is None else _Rows(device, normals, "normals", self.stream)
        if self.normals is not None and (self.normals.shape != self.positions.shape or
                                         self.normals.on_gpu != self.on_gpu):
            raise InvalidArgument(f"normals: expected as many as positions, and where they lie: {shape_text(self.positions.shape)}"
                                  f"[3], got {shape_text(self.normals.shape)}[3]")
        self.min_cosine = to_number(min_cosine, "min_cosine")
        self.count = self.positions.count

    def empty(self, shape: Tuple[int, ...], dtype: str) -> Any:
        if not self.on_gpu:
            return np.empty(shape, dtype)
        if dtype == "uint32":
            dtype = self.library.id_dtype
        if dtype == "uint64":
            dtype = self.library.offset_dtype
        needs: List[Any] = [self.positions.view, self.normals and self.normals.view, self.photons]
        return self.library.empty(shape, dtype, self.positions.like, self.photons.device._core, needs)

    def address(self, array: Any) -> int:
        if array is None:
            return 0
        if not self.on_gpu:
            return int(array.ctypes.data)
        return _ready_view(self.photons.device, array, "result", self.stream).data

    def finish(self, array: Any) -> Any:
        if not self.on_gpu:
            return array
        if isinstance(array, DeviceArray):
            array.mark_queued()
        return self.library.finish(array)

    def ask(self, kind: str, radius: float, *, method: int = 0, kernel: int = 0, hint: float = 0, k: int = 0,
            counts: Any = None, sums: Any = None, ids: Any = None, distances: Any = None) -> None:
        """Counts, sums and nearest points: queued on a GPU, slice by slice elsewhere, between which Ctrl-C is noticed."""
        code = PHOTON_QUERY.value(kind)
        data = [self.address(a) for a in (counts, sums, ids, distances)]
        widths = (4, 12, 4 * k, 4 * k)
        normals = self.normals.data if self.normals is not None else 0
        for part in [slice(0, self.count)] if self.on_gpu else slices(self.count):
            first = part.start
            at = [d and d + first * width for d, width in zip(data, widths)]
            self.photons._core.query(code, method, kernel, self.on_gpu, part.stop - first,
                                     self.positions.data + 12 * first, normals and normals + 12 * first,
                                     self.min_cosine, radius, hint, k, at[0], at[1], 0, at[2], at[3], 0,
                                     self.stream if method == 0 else None)

    def list(self, radius: float, method: int) -> Tuple[Any, Any, Any]:
        offsets = self.empty((self.count + 1,), "uint64")
        normals = self.normals.data if self.normals is not None else 0

        def ask(ids: int, distances: int, capacity: int) -> None:
            self.photons._core.query(PHOTON_QUERY.value("list"), method, 0, self.on_gpu, self.count, self.positions.data,
                                     normals, self.min_cosine, radius, 0, 0, 0, 0, where, ids, distances, capacity, None)

        where = self.address(offsets)
        ask(0, 0, 0)
        total = self.library.last(offsets) if self.on_gpu else int(offsets[-1])
        ids, distances = self.empty((total,), "uint32"), self.empty((total,), "float32")
        if total != 0:
            ask(self.address(ids), self.address(distances), total)
        finish = self.library.finish if self.on_gpu else lambda array: array
        return finish(ids), finish(distances), finish(offsets)


class PhotonMap:
    """Points, with a flux and a normal each where they are wanted, for queries of those near a place.

    :param positions: float32 [n][3].
    :param fluxes: float32 [n][3], not negative; kept as mantissas of 8 bits with a common exponent, rounded without bias.
    :param normals: float32 [n][3], of any length; kept in steps of 1/127.
    :param radius: that queries will mostly have; None: one that holds about 50 points where they lie densely.
    :param levels: grids, each with cells 4 times larger than the one before; with 4, nearest points that are far away are
        found faster.
    :param device: where the map lies; None: the default device.

    Arrays are numpy arrays, or anything that numpy takes, or arrays of PyTorch, CuPy or JAX, which are read on the GPU where
    they lie. Answers have the same bits on every device; they are numpy arrays, or for queries in arrays on a GPU arrays of
    that library, which are queued on its stream. A place that is not finite finds nothing.

    Raises InvalidArgument, naming the first element that is not allowed; OutOfMemory.
    """

    def __init__(self, positions: Any, fluxes: Any = None, normals: Any = None, *, radius: Optional[float] = None,
                 levels: int = 1, device: Optional[Device] = None) -> None:
        self.device = device or default_device()
        points = _Rows(self.device, positions, "positions")
        others = [None if value is None else _Rows(self.device, value, name)
                  for value, name in ((fluxes, "fluxes"), (normals, "normals"))]
        for rows, name in zip(others, ("fluxes", "normals")):
            if rows is not None and (rows.count != points.count or rows.on_gpu != points.on_gpu):
                raise InvalidArgument(f"{name}: expected as many as positions, and where they lie: {points.count} rows, "
                                      f"got {rows.count}")
        with self.device._log_errors():
            flux_data, normal_data = (0 if rows is None else rows.data for rows in others)
            self._core = _core.PhotonMap(self.device._core, points.on_gpu, points.count, points.data, flux_data,
                                         normal_data, 0.0 if radius is None else _radius(radius),
                                         to_count(levels, "levels"))
        self._radius = self.info.radius

    @classmethod
    def _trace(cls, scene: Any, num_paths: int, seed: int, pass_index: int, frame_index: int, max_depth: int,
               radius: Optional[float], levels: int) -> "PhotonMap":
        photons = cls.__new__(cls)
        photons.device = scene.device
        with photons.device._log_errors():
            photons._core = _core.PhotonMap.trace(scene._core, to_count(num_paths, "num_paths"),
                                                  to_count(seed, "seed", 64), to_count(pass_index, "pass_index", 64),
                                                  to_count(frame_index, "frame_index"), to_count(max_depth, "max_depth"),
                                                  0.0 if radius is None else _radius(radius), to_count(levels, "levels"))
        photons._radius = photons.info.radius
        return photons

    @classmethod
    def load(cls, path: PathLike, device: Optional[Device] = None) -> "PhotonMap":
        """Reads a map that save() wrote. Raises FileError."""
        photons = cls.__new__(cls)
        photons.device = device or default_device()
        photons._core = _core.PhotonMap.load(photons.device._core, to_path(path))
        photons._radius = photons.info.radius
        return photons

    def save(self, path: PathLike) -> None:
        """Writes the map to a file, under a temporary name that is then changed. Raises FileError."""
        self._core.save(to_path(path))

    def read(self, attribute: str = "position") -> Any:
        """What the map keeps of its points, in the order of ids: float32 [n][3].

        :param attribute: "position", "flux" as it counts in sums, "normal" in steps of 1/127, or "direction" of flight.

        Raises InvalidArgument for what the map was made without.
        """
        values = np.empty((len(self), 3), np.float32)
        self._core.read(PHOTON_ATTRIBUTE.value(attribute), values.ctypes.data, values.nbytes)
        return values

    @property
    def info(self) -> PhotonMapInfo:
        return PhotonMapInfo(**self._core.info())

    def __len__(self) -> int:
        return self.info.num_points

    def count(self, positions: Any, radius: Optional[float] = None, *, normals: Any = None, min_cosine: float = 0.0,
              method: str = "grid") -> Any:
        """How many points are within the radius of places [...][3]: uint32 [...].

        :param radius: None: that of the map.
        :param normals: [...][3]; points count whose normal has a cosine with it above min_cosine.
        :param method: "grid", or "node_lists": the lists of a kd-tree's leaves, to compare with.
        """
        batch = _Batch(self, positions, normals, min_cosine)
        counts = batch.empty(batch.positions.shape, "uint32")
        batch.ask("count", self._radius_of(radius), method=GATHER_METHOD.value(method), counts=counts)
        return batch.finish(counts)

    def sum(self, positions: Any, radius: Optional[float] = None, *, kernel: str = "constant", normals: Any = None,
            min_cosine: float = 0.0, method: str = "grid") -> Any:
        """The sum of the fluxes of the points within the radius: float32 [...][3].

        :param kernel: the weight of a point at distance d: "constant" (1), "cone" (1 - d/r) or "quadratic" (1 - d^2/r^2).
        """
        batch = _Batch(self, positions, normals, min_cosine)
        sums = batch.empty((*batch.positions.shape, 3), "float32")
        batch.ask("sum", self._radius_of(radius), method=GATHER_METHOD.value(method),
                  kernel=GATHER_KERNEL.value(kernel), sums=sums)
        return batch.finish(sums)

    def within(self, positions: Any, radius: Optional[float] = None, *, normals: Any = None, min_cosine: float = 0.0,
               method: str = "grid") -> Tuple[Any, Any, Any]:
        """Which points are within the radius: (ids, distances, offsets); place i, counted over [...], has ids[offsets[i] :
        offsets[i + 1]], in the order in which the map keeps them."""
        batch = _Batch(self, positions, normals, min_cosine)
        return batch.list(self._radius_of(radius), GATHER_METHOD.value(method))

    def nearest(self, positions: Any, k: int = 1, *, radius: Optional[float] = None,
                hint: Optional[float] = None) -> Tuple[Any, Any]:
        """The k nearest points: (ids, distances), [...][k], sorted by distance, then id; INVALID_ID and inf where there are
        no more.

        :param radius: points farther away do not count; None: all do.
        :param hint: about what holds k points; changes the speed alone.
        """
        batch = _Batch(self, positions, None, 0.0)
        number = to_count(k, "k")
        ids = batch.empty((*batch.positions.shape, number), "uint32")
        distances = batch.empty((*batch.positions.shape, number), "float32")
        batch.ask("nearest", 0.0 if radius is None else _radius(radius), hint=0.0 if hint is None else _radius(hint, "hint"),
                  k=number, ids=ids, distances=distances)
        return batch.finish(ids), batch.finish(distances)

    def _radius_of(self, radius: Optional[float]) -> float:
        return self._radius if radius is None else _radius(radius)

    def __repr__(self) -> str:
        info = self.info
        return f"<gpurt.PhotonMap of {info.num_points} points, radius {info.radius:g}, {info.memory_bytes / 2**20:.1f} MiB>"

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.PhotonMap", "save it and load it in the other process")


def _radius(value: Any, name: str = "radius") -> float:
    """0 means another thing to the C library."""
    radius = to_number(value, name)
    if radius == 0:
        raise InvalidArgument(f"{name}: is 0; give a positive number, or None")
    return radius
