"""PyTorch, CuPy and JAX as far as queries need them: which stream the caller works on, arrays for results, columns.

Nothing here imports a library: an array that is handed in has brought its own.
"""

from __future__ import annotations

import contextlib
import importlib
import sys
from typing import Any, ContextManager, Optional, Sequence, Tuple

import numpy as np

from gpurt import _core
from gpurt._arrays import HOST_DEVICES
from gpurt._memory import CPU, CUDA, DEFAULT_STREAM, ON_GPU, DeviceArray, device_of, has_dlpack


class Library:
    """Any library with DLPack or the CUDA array interface: results are gpurt.DeviceArray."""

    #: How a caller makes an array fit, for messages.
    to_float32, to_int32, to_packed, to_host, to_device = (
        "convert it to float32", "convert it to int32 or uint32", "make it contiguous", "copy it to host memory",
        "copy it to CUDA device {}")
    #: Of the ids of hits, and of offsets.
    id_dtype, offset_dtype = "uint32", "uint64"

    def stream(self, like: Any) -> int:
        """The stream on which the caller's work on this array goes."""
        return DEFAULT_STREAM

    def current_device(self, like: Any) -> ContextManager[Any]:
        """Makes the device of an array the library's current one."""
        return contextlib.nullcontext()

    def empty(self, shape: Sequence[int], dtype: str, like: Any, device: _core.Device, needs: Any) -> Any:
        """An array for results, where `like` lies. `needs` is what work that writes it reads."""
        kind, index = device_of(like)
        return DeviceArray(device, (CUDA, index) if kind in ON_GPU else (CPU, 0), shape, dtype, needs)

    def finish(self, array: Any) -> Any:
        """What `empty` gave, once it is written or will be, as the caller gets it."""
        return array

    def column(self, packed: Any, index: int, dtype: str) -> Any:
        """packed[..., index], whose bits are of another type."""
        raise TypeError("take the columns of Hits.packed with the library that it is handed to")

    def last(self, array: Any) -> int:
        """The last element of what `empty` gave; work that writes it is done."""
        return int(array.last())

    def pack_rays(self, parts: Sequence[Any], like: Any) -> Any:
        """[...][8] of [...][3], [...], [...][3] and [...], broadcast against each other, where `like` lies."""
        raise TypeError("origins: cannot be packed into rays for this kind of array; give rays [...][8]")


class Torch(Library):
    to_float32, to_int32, to_packed, to_host, to_device = (
        "use .float()", "use .to(torch.int32)", "use .contiguous()", "use .cpu()", "use .to('cuda:{}')")
    # Other unsigned integers than of 8 bits have few operations. INVALID_ID is -1.
    id_dtype, offset_dtype = "int32", "int64"

    def __init__(self) -> None:
        self.torch = sys.modules["torch"]

    def stream(self, like: Any) -> int:
        return self.torch.cuda.current_stream(like.device).cuda_stream or DEFAULT_STREAM

    def current_device(self, like: Any) -> ContextManager[Any]:
        return self.torch.cuda.device(like.device) if like.is_cuda else contextlib.nullcontext()

    def empty(self, shape: Sequence[int], dtype: str, like: Any, device: _core.Device, needs: Any) -> Any:
        return self.torch.empty(tuple(shape), dtype=getattr(self.torch, dtype), device=like.device)

    def column(self, packed: Any, index: int, dtype: str) -> Any:
        return packed.view(getattr(self.torch, dtype))[..., index]

    def last(self, array: Any) -> int:
        return int(array[-1])

    def pack_rays(self, parts: Sequence[Any], like: Any) -> Any:
        tensors = [self.torch.as_tensor(p, dtype=self.torch.float32, device=like.device) for p in parts]
        shape = _common_shape(tensors)
        return self.torch.cat([t.expand(*shape, 3) if i % 2 == 0 else t.expand(shape)[..., None]
                               for i, t in enumerate(tensors)], dim=-1)


class Cupy(Library):
    to_float32, to_int32, to_packed, to_host, to_device = (
        "use .astype(cupy.float32)", "use .astype(cupy.uint32)", "use cupy.ascontiguousarray", "use .get()",
        "make it with cupy.cuda.Device({})")

    def __init__(self) -> None:
        self.cupy = sys.modules["cupy"]

    def stream(self, like: Any) -> int:
        with like.device:
            return self.cupy.cuda.get_current_stream().ptr or DEFAULT_STREAM

    def current_device(self, like: Any) -> ContextManager[Any]:
        device: ContextManager[Any] = like.device
        return device

    def empty(self, shape: Sequence[int], dtype: str, like: Any, device: _core.Device, needs: Any) -> Any:
        with like.device:
            return self.cupy.empty(tuple(shape), dtype)

    def column(self, packed: Any, index: int, dtype: str) -> Any:
        return packed.view(dtype)[..., index]

    def last(self, array: Any) -> int:
        return int(array[-1])

    def pack_rays(self, parts: Sequence[Any], like: Any) -> Any:
        with like.device:
            arrays = [self.cupy.asarray(p, self.cupy.float32) for p in parts]
            return _concatenate(self.cupy, arrays)


class Jax(Library):
    to_float32, to_int32, to_packed, to_host, to_device = (
        "use .astype(jnp.float32)", "use .astype(jnp.uint32)", "copy it", "use jax.device_put to the CPU",
        "use jax.device_put to GPU {}")

    def __init__(self) -> None:
        self.numpy = importlib.import_module("jax.numpy")
        self.lax = importlib.import_module("jax.lax")

    def finish(self, array: Any) -> Any:
        # Its arrays never change: they are made once the work that writes them is queued.
        return self.numpy.from_dlpack(array)

    def column(self, packed: Any, index: int, dtype: str) -> Any:
        column = packed[..., index]
        return column if dtype == "float32" else self.lax.bitcast_convert_type(column, dtype)

    def pack_rays(self, parts: Sequence[Any], like: Any) -> Any:
        return _concatenate(self.numpy, [self.numpy.asarray(p, self.numpy.float32) for p in parts])


def _common_shape(arrays: Sequence[Any]) -> Tuple[int, ...]:
    return np.broadcast_shapes(*(tuple(a.shape)[:-1] if i % 2 == 0 else tuple(a.shape) for i, a in enumerate(arrays)))


def _concatenate(numpy: Any, arrays: Sequence[Any]) -> Any:
    shape = _common_shape(arrays)
    return numpy.concatenate([numpy.broadcast_to(a, (*shape, 3)) if i % 2 == 0
                              else numpy.broadcast_to(a, shape)[..., None] for i, a in enumerate(arrays)], -1)


def library_of(value: Any) -> Optional[Library]:
    """The library of an array; None: numpy, or nothing that has one, which numpy takes."""
    root = type(value).__module__.partition(".")[0]
    if root == "torch" and has_dlpack(value):
        return Torch()
    if root == "cupy":
        return Cupy()
    if root in ("jax", "jaxlib") and has_dlpack(value):
        return Jax()
    if root == "numpy":
        return None
    if has_dlpack(value):
        # In host memory numpy takes it, and hands out numpy arrays.
        return Library() if device_of(value)[0] not in HOST_DEVICES or isinstance(value, DeviceArray) else None
    return Library() if hasattr(value, "__cuda_array_interface__") else None
