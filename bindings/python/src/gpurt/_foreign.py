"""Queries on, and meshes of, arrays of other libraries: read and written where they are.

On a GPU queries are queued on the stream on which the caller's library works, so nothing waits on the host and nothing
travels through host memory.
"""

from __future__ import annotations

import contextlib
from typing import Any, Optional, Tuple, Union

import numpy as np

from gpurt import _core
from gpurt._arrays import HOST_DEVICES, Array, float_rows, index_rows, shape_text
from gpurt._libraries import Library, library_of
from gpurt._memory import (DEFAULT_STREAM, ON_GPU, DeviceArray, View, device_of, has_dlpack, numpy_view, place_text,
                           view)
from gpurt._names import COHERENCE, HIT_FORMAT, QUERY
from gpurt._trace import check_rays, image_width, slices
from gpurt.device import Device
from gpurt.errors import InvalidArgument
from gpurt.hits import Hits

Rows = Union[Array, Tuple[_core.Buffer, int, int, int]]


def _is_on_gpu(value: Any) -> bool:
    return device_of(value)[0] in ON_GPU


def _check_place(device: Device, value: Any, name: str, library: Library) -> None:
    """Memory that the device can reach: host memory, or its own."""
    kind, index = device_of(value)
    if kind not in (*HOST_DEVICES, *ON_GPU):
        raise InvalidArgument(f"{name}: lies in {place_text((kind, index))}, which is neither host memory nor a CUDA "
                              f"device's own; {library.to_host}")
    if kind in HOST_DEVICES:
        return
    if not device._is_cuda:
        raise InvalidArgument(f"{name}: lies on CUDA device {index}, but the scene on the CPU; {library.to_host}, or "
                              "make the scene on gpurt.Device('cuda')")
    if has_dlpack(value) and index not in device._ordinals:
        raise InvalidArgument(f"{name}: lies on CUDA device {index}, but the scene on "
                              f"{', '.join(map(str, device._ordinals))}; {library.to_device.format(device._ordinals[0])}")


def _ready_view(device: Device, value: Any, name: str, stream: Optional[int]) -> View:
    """A view whose elements are ready for work on the stream."""
    library = library_of(value)
    # Libraries hand out what lies on their current device alone.
    with library.current_device(value) if library else contextlib.nullcontext():
        found = view(value, name, stream)
    if not found.on_host and found.stream != stream and stream is not None and found.stream is not None:
        device._core.order_streams(device._ordinals[0], stream, found.stream)
    return found


class _Query:
    """One call of Scene.trace with rays of a library."""

    def __init__(self, device: Device, scene: _core.Scene, library: Library, rays: Any, query: str, format: str,
                 coherence: str) -> None:
        self.device, self.scene, self.library, self.like = device, scene, library, rays
        self.kind, self.format = QUERY.value(query), HIT_FORMAT.value(format)
        self.width = (8, 4)[self.format]
        _check_place(device, rays, "rays", library)
        self.on_gpu = _is_on_gpu(rays)
        # All hits are found with the host's help, which orders itself by the default stream.
        self.stream = (DEFAULT_STREAM if query == "all" else library.stream(rays)) if self.on_gpu else None
        self.rays = self._device_rays() if self.on_gpu else numpy_view(check_rays(rays), "rays")
        self.shape = self.rays.shape[:-1]
        self.num_rays = self.rays.size // 8
        self.hints = (COHERENCE.value(coherence), image_width(self.rays.shape))

    def _device_rays(self) -> View:
        rays = _ready_view(self.device, self.like, "rays", self.stream)
        if not rays.shape or rays.shape[-1] != 8:
            raise rays.refuse("expected [...][8] = ox oy oz tmin dx dy dz tmax", "pack them with gpurt.make_rays")
        if rays.dtype != "float32":
            raise rays.refuse("expected float32", self.library.to_float32)
        if not rays.is_packed():
            raise rays.refuse(f"expected rays without gaps, not strides {rays.strides}", self.library.to_packed)
        return rays

    def empty(self, shape: Tuple[int, ...], dtype: str) -> Any:
        return self.library.empty(shape, dtype, self.like, self.device._core, self.rays)

    def target(self, array: Any, name: str, shape: Tuple[int, ...], dtype: str) -> View:
        """Where results go, after what the caller's work still does there."""
        found = _ready_view(self.device, array, name, self.stream)
        if found.on_host == self.on_gpu or (self.on_gpu and found.device[1] != self.rays.device[1]):
            raise found.refuse(f"expected an array where the rays are, in {self.rays.place}", "make it there")
        if found.shape != shape or found.dtype != dtype or not found.is_packed() or found.read_only:
            raise found.refuse(f"expected a writeable array without gaps of {dtype} {shape_text(shape)}",
                               "make such a one, or leave out away")
        return found

    def run(self, hits: int = 0, occluded: int = 0) -> None:
        """Closest or any hits, at these addresses."""
        if self.on_gpu:
            self.scene.trace_memory(self.kind, self.format, True, self.num_rays, self.rays.data, hits, 0, occluded, 0,
                                    self.stream, *self.hints)
            return
        for part in slices(self.num_rays):
            first = part.start
            self.scene.trace_memory(self.kind, self.format, False, part.stop - first, self.rays.data + 32 * first,
                                    hits and hits + 4 * self.width * first, 0, occluded and occluded + first, 0, None,
                                    *self.hints)

    def finish(self, array: Any) -> Any:
        if self.on_gpu and isinstance(array, DeviceArray):
            array.mark_queued()
        return self.library.finish(array)

    def closest(self, out: Any) -> Hits:
        packed = out.packed if isinstance(out, Hits) else out
        array = self.empty((*self.shape, self.width), "float32") if packed is None else packed
        self.run(hits=self.target(array, "out", (*self.shape, self.width), "float32").data)
        return Hits(self.library, self.finish(array) if packed is None else array)

    def any(self, out: Any) -> Any:
        array = self.empty(self.shape, "bool") if out is None else out
        self.run(occluded=self.target(array, "out", self.shape, "bool").data)
        return self.finish(array) if out is None else array

    def all(self) -> Tuple[Hits, Any]:
        """Counts first, then fills exactly that much memory."""
        n, dtype = self.num_rays, self.library.offset_dtype
        offsets = self.empty((n + 1,), dtype)
        place = self.target(offsets, "offsets", (n + 1,), dtype)
        arguments = (self.kind, self.format, self.on_gpu, n, self.rays.data)
        self.scene.trace_memory(*arguments, 0, 0, 0, place.data, None, 0, 0)
        total = self.library.last(offsets)
        hits = self.empty((total, self.width), "float32")
        if total != 0:
            target = self.target(hits, "hits", (total, self.width), "float32")
            self.scene.trace_memory(*arguments, target.data, total, 0, place.data, None, 0, 0)
        return Hits(self.library, self.library.finish(hits)), self.library.finish(offsets)


def trace_foreign(device: Device, scene: _core.Scene, library: Library, rays: Any, query: str, format: str,
                  out: Any, coherence: str) -> Any:
    batch = _Query(device, scene, library, rays, query, format, coherence)
    if query == "all":
        if out is not None:
            raise InvalidArgument("out: not with query='all', whose number of hits is found while tracing")
        return batch.all()
    if out is not None and type(library).finish is not Library.finish:
        raise InvalidArgument("out: arrays of this library never change; leave out away")
    return batch.closest(out) if query == "closest" else batch.any(out)


def mesh_rows(device: Device, value: Any, name: str, columns: int, expected: str, share: bool) -> Rows:
    """float32 [n][columns], or uint32 for `indices`: an array in host memory, or rows in a buffer where share is set or
    the array lies on a GPU."""
    library = library_of(value)
    on_gpu = library is not None and _is_on_gpu(value)
    if not on_gpu and not share:
        return index_rows(value, name) if name == "indices" else float_rows(value, name, columns, expected)
    if library is None:
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{name}: share=True needs an array to share, got {type(value).__name__}")
        library, source = Library(), numpy_view(value, name)
    else:
        _check_place(device, value, name, library)
        source = _ready_view(device, value, name, DEFAULT_STREAM if on_gpu else None)
    wanted = ("uint32", "int32") if name == "indices" else ("float32",)
    if source.dtype not in wanted:
        raise source.refuse(f"expected {' or '.join(wanted)}, which can be read as it is",
                            library.to_int32 if name == "indices" else library.to_float32)
    if len(source.shape) < 2 or source.shape[-1] != columns:
        raise source.refuse(f"expected {expected}", "change its shape")
    if source.size == 0:
        return np.zeros((0, columns), np.uint32 if name == "indices" else np.float32)
    # Rows may be apart from each other; within a row, and across more than one leading axis, there are no gaps.
    row = columns
    if len(source.shape) == 2 and source.strides is not None and source.shape[0] > 1:
        row = source.strides[0]
    if not source.is_packed(1 if len(source.shape) == 2 else 0) or row < columns:
        raise source.refuse(f"expected packed rows, not strides {source.strides}", library.to_packed)
    count = source.size // columns
    size_bytes = ((count - 1) * row + columns) * source.itemsize
    buffer = _core.Buffer(device._core, on_gpu, size_bytes, source.data, source)
    return buffer, 0, row * source.itemsize, count
