"""Ray batches: checks, conversions, and slices between which Ctrl-C is noticed."""

from __future__ import annotations

import math
from typing import Any, Iterator, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from gpurt import _core
from gpurt._arrays import Array, FloatArray, as_array, shape_text, to_float32
from gpurt._libraries import Library, library_of
from gpurt._names import COHERENCE, HIT_FORMAT, QUERY
from gpurt.errors import InvalidArgument

#: A hit: t (the ray's tmax for a miss), barycentric weights u, v of the second and third corner, and the ids of
#: triangle, geometry and instance (INVALID_ID for a miss). 32 bytes, as the C library's gpurt_hit.
hit_dtype = np.dtype({
    "names": ["t", "u", "v", "primitive", "geometry", "instance"],
    "formats": ["<f4", "<f4", "<f4", "<u4", "<u4", "<u4"],
    "itemsize": 32,
})
#: The same without geometry and instance: 16 bytes.
hit_compact_dtype = np.dtype([("t", "<f4"), ("u", "<f4"), ("v", "<f4"), ("primitive", "<u4")])

# About a second of work for a small CPU, and enough to fill the largest GPU.
RAYS_PER_CALL = 1 << 22


def make_rays(origins: Any, directions: Any, tmin: Any = 0.0, tmax: Any = math.inf) -> Any:
    """Rays as float32 [...][8] = ox oy oz tmin dx dy dz tmax.

    origins and directions [...][3], tmin and tmax [...] are broadcast against each other. Of PyTorch, CuPy or JAX
    arrays they are made by that library, where the arrays lie.
    """
    parts = (origins, tmin, directions, tmax)
    for part in parts:
        library = library_of(part)
        if library is not None:
            return _pack_foreign(library, parts, part)
    o, d = as_array(origins, "origins"), as_array(directions, "directions")
    for array, name in ((o, "origins"), (d, "directions")):
        if array.ndim < 1 or array.shape[-1] != 3:
            raise InvalidArgument(f"{name}: expected [...][3], got {shape_text(array.shape)}")
    near, far = as_array(tmin, "tmin"), as_array(tmax, "tmax")
    try:
        shape = np.broadcast_shapes(o.shape[:-1], d.shape[:-1], near.shape, far.shape)
    except ValueError:
        raise InvalidArgument("origins, directions, tmin, tmax: shapes do not fit together: " + ", ".join(
            shape_text(a.shape) for a in (o, d, near, far))) from None
    rays = np.empty((*shape, 8), np.float32)
    rays[..., 0:3] = to_float32(o, "origins")
    rays[..., 3] = to_float32(near, "tmin")
    rays[..., 4:7] = to_float32(d, "directions")
    rays[..., 7] = to_float32(far, "tmax")
    return rays


def _pack_foreign(library: Library, parts: Sequence[Any], like: Any) -> Any:
    for part, name in ((parts[0], "origins"), (parts[2], "directions")):
        shape = tuple(part.shape) if hasattr(part, "shape") else np.shape(part)
        if not shape or shape[-1] != 3:
            raise InvalidArgument(f"{name}: expected [...][3], got {shape_text(shape)}")
    try:
        return library.pack_rays(parts, like)
    except (RuntimeError, TypeError, ValueError) as error:
        raise InvalidArgument(f"origins, directions, tmin, tmax: do not fit together: {error}") from error


def check_rays(value: Any) -> FloatArray:
    array = as_array(value, "rays")
    if array.ndim < 1 or array.shape[-1] != 8:
        raise InvalidArgument(f"rays: expected [...][8] = ox oy oz tmin dx dy dz tmax, got {shape_text(array.shape)}")
    rays = to_float32(array, "rays")
    return rays if rays.flags.c_contiguous and rays.flags.aligned else np.ascontiguousarray(rays)


def slices(count: int) -> Iterator[slice]:
    for start in range(0, count, RAYS_PER_CALL):
        yield slice(start, min(start + RAYS_PER_CALL, count))


def check_out(out: Any, shape: Tuple[int, ...], dtype: "np.dtype[Any]") -> Array:
    """The caller's array for results."""
    if not isinstance(out, np.ndarray):
        raise TypeError(f"out: expected a numpy array, got {type(out).__name__}")
    if out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous or not out.flags.writeable:
        raise InvalidArgument(f"out: expected a writeable C-contiguous array of {dtype} {shape_text(shape)}, "
                              f"got {out.dtype} {shape_text(out.shape)}")
    return out


def image_width(shape: Tuple[int, ...]) -> int:
    """Rays [height][width][8] are an image's."""
    return shape[-2] if len(shape) == 3 and 0 < shape[-2] < 1 << 32 else 0


def trace(scene: _core.Scene, rays_given: Any, query: str, format: str, out: Optional[Array],
          coherence: str) -> Union[Array, Tuple[Array, npt.NDArray[np.uint64]]]:
    kind, hit_format = QUERY.value(query), HIT_FORMAT.value(format)
    dtype = (hit_dtype, hit_compact_dtype)[hit_format]
    rays_shaped = check_rays(rays_given)
    shape = rays_shaped.shape[:-1]
    hints = (COHERENCE.value(coherence), image_width(rays_shaped.shape))
    rays = rays_shaped.reshape(-1, 8)
    if query == "all":
        if out is not None:
            raise InvalidArgument("out: not with query='all', whose number of hits is found while tracing")
        return trace_all(scene, rays, hit_format, dtype)
    if query == "any":
        occluded = np.empty(shape, np.bool_) if out is None else check_out(out, shape, np.dtype(np.bool_))
        flags = occluded.reshape(-1).view(np.uint8)
        for part in slices(len(rays)):
            scene.trace(kind, hit_format, rays[part], None, flags[part], None, *hints)
        return occluded
    hits = np.empty(shape, dtype) if out is None else check_out(out, shape, dtype)
    flat = hits.reshape(-1)
    for part in slices(len(rays)):
        scene.trace(kind, hit_format, rays[part], flat[part], None, None, *hints)
    return hits


def trace_all(scene: _core.Scene, rays: FloatArray, hit_format: int,
              dtype: "np.dtype[Any]") -> Tuple[Array, npt.NDArray[np.uint64]]:
    """Counts first, then fills exactly that much memory."""
    kind = QUERY.value("all")
    offsets = np.zeros(len(rays) + 1, np.uint64)
    scratch = np.empty(min(len(rays), RAYS_PER_CALL) + 1, np.uint64)
    for part in slices(len(rays)):
        counted = scratch[:part.stop - part.start + 1]
        scene.trace(kind, hit_format, rays[part], None, None, counted, 0, 0)
        offsets[part.start + 1:part.stop + 1] = counted[1:] + offsets[part.start]
    hits = np.empty(int(offsets[-1]), dtype)
    for part in slices(len(rays)):
        found = hits[int(offsets[part.start]):int(offsets[part.stop])]
        scene.trace(kind, hit_format, rays[part], found, None, scratch[:part.stop - part.start + 1],
                    0, 0)
    return hits, offsets
