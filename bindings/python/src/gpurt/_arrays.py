"""From what users have to what the C library reads: numpy arrays of the right type and layout.

Nothing is copied where the type and the layout fit already; every conversion that loses nothing, or rounds to
float32, is done by a copy. What does not fit raises InvalidArgument (TypeError for what is no array), naming the
argument.
"""

from __future__ import annotations

import os
from typing import Any, Optional, Sequence, Tuple, Union

import numpy as np
import numpy.typing as npt

from gpurt.errors import InvalidArgument

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float32]
UIntArray = npt.NDArray[np.uint32]
PathLike = Union[str, bytes, "os.PathLike[str]", "os.PathLike[bytes]"]
Vector = Union[Sequence[float], Array]

#: Of DLPack: host memory, plain and page-locked by CUDA.
HOST_DEVICES = (1, 3)

IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def shape_text(shape: Sequence[int]) -> str:
    return "".join(f"[{n}]" for n in shape) or "a single value"


def as_array(value: Any, name: str) -> Array:
    """Any array in host memory: numpy, DLPack, the buffer protocol, or nested sequences of numbers."""
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise InvalidArgument(f"{name}: has masked elements; fill or remove them")
    if hasattr(value, "__dlpack__") and not isinstance(value, (np.ndarray, np.generic)):
        device = value.__dlpack_device__() if hasattr(value, "__dlpack_device__") else (1, 0)
        if device[0] not in HOST_DEVICES:
            raise InvalidArgument(f"{name}: lies on another device (DLPack type {int(device[0])}); this argument is read "
                                  "from host memory: copy it there first, such as with .cpu() or .get()")
        try:
            return np.from_dlpack(value)
        except (BufferError, RuntimeError, TypeError) as error:
            raise InvalidArgument(f"{name}: cannot be read through DLPack: {error}") from error
    if value is None or isinstance(value, (str, dict, set)):
        raise TypeError(f"{name}: expected an array, got {type(value).__name__}")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"{name}: is no array: {error}") from error
    if array.dtype.kind not in "biuf":
        raise TypeError(f"{name}: expected an array of numbers, got elements of type {array.dtype}")
    return array


def to_float32(array: Array, name: str) -> FloatArray:
    """Rounds to float32; a value beyond its range is an error."""
    if array.dtype == np.float32 and array.dtype.isnative:
        return array
    if array.dtype.kind not in "iuf":
        raise InvalidArgument(f"{name}: expected numbers, got {array.dtype}")
    with np.errstate(over="ignore"):
        converted = array.astype(np.float32)
    if array.dtype.kind == "f" and array.dtype.itemsize > 4:
        lost = np.isinf(converted) & np.isfinite(array)
        if lost.any():
            where = tuple(int(i) for i in np.argwhere(lost)[0])
            raise InvalidArgument(f"{name}: {array[where]} at {shape_text(where)} is beyond the range of float32")
    return converted


def to_uint32(array: Array, name: str) -> UIntArray:
    """Integers that fit; the first that does not is named."""
    if array.dtype == np.uint32 and array.dtype.isnative:
        return array
    if array.size == 0:
        return array.astype(np.uint32)
    if array.dtype.kind not in "iu":
        raise InvalidArgument(f"{name}: expected integers, got {array.dtype}")
    wrong = (array < 0) | (array > 0xFFFFFFFF) if array.dtype.itemsize > 4 else array < 0
    if wrong.any():
        where = tuple(int(i) for i in np.argwhere(wrong)[0])
        raise InvalidArgument(f"{name}: {int(array[where])} at {shape_text(where)} does not fit into uint32")
    return array.astype(np.uint32)


def packed_rows(array: Array) -> Array:
    """The array itself if each row is packed and rows follow each other; else a copy."""
    row_bytes = array.shape[1] * array.itemsize
    fits = (array.flags.aligned and (array.shape[1] < 2 or array.strides[1] == array.itemsize)
            and (array.shape[0] < 2 or array.strides[0] >= row_bytes))
    return array if fits else np.ascontiguousarray(array)


def float_rows(value: Any, name: str, columns: int, expected: str) -> FloatArray:
    """float32 [n][columns]; leading axes beyond one are flattened."""
    array = as_array(value, name)
    if array.size == 0 and array.ndim == 1:
        array = array.reshape(0, columns)
    if array.ndim < 2 or array.shape[-1] != columns:
        raise InvalidArgument(f"{name}: expected {expected}, got {shape_text(array.shape)}")
    return packed_rows(to_float32(array, name).reshape(-1, columns))


def index_rows(value: Any, name: str) -> UIntArray:
    """uint32 [m][3]."""
    array = as_array(value, name)
    if array.size == 0:
        return np.zeros((0, 3), np.uint32)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidArgument(f"{name}: expected [m][3], got {shape_text(array.shape)}")
    return packed_rows(to_uint32(array, name))


def to_transform(value: Any, name: str = "transform") -> Tuple[float, ...]:
    """3 rows of 4 from [3][4], or from [4][4] with the last row 0 0 0 1; None is the identity."""
    if value is None:
        return IDENTITY
    matrix = as_array(value, name)
    if matrix.shape not in ((3, 4), (4, 4)):
        raise InvalidArgument(f"{name}: expected [3][4] or [4][4], got {shape_text(matrix.shape)}")
    if matrix.shape == (4, 4) and list(matrix[3]) != [0, 0, 0, 1]:
        raise InvalidArgument(f"{name}: the last row must be 0 0 0 1, got {' '.join(str(x) for x in matrix[3])}")
    return tuple(float(x) for x in to_float32(matrix, name)[:3].ravel())


def to_vec3(value: Any, name: str, spread: bool = False) -> Tuple[float, float, float]:
    """Three numbers; with spread also one number for all three."""
    array = as_array(value, name)
    if spread and array.ndim == 0:
        array = np.repeat(array, 3)
    if array.shape != (3,):
        raise InvalidArgument(f"{name}: expected {'a number or ' if spread else ''}3 numbers, "
                              f"got {shape_text(array.shape)}")
    x, y, z = to_float32(array, name)
    return float(x), float(y), float(z)


def to_count(value: Any, name: str, bits: int = 32) -> int:
    """An integer that fits into an unsigned C type."""
    try:
        number = int(value.__index__())
    except AttributeError:
        raise TypeError(f"{name}: expected an integer, got {type(value).__name__}") from None
    if not 0 <= number < 2 ** bits:
        raise InvalidArgument(f"{name}: {number} is outside [0, 2^{bits})")
    return number


def to_number(value: Any, name: str) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name}: expected a number, got {type(value).__name__}") from None


def to_path(path: PathLike) -> bytes:
    return os.fsencode(path)


def optional_path(path: Optional[PathLike]) -> Optional[bytes]:
    return None if path is None else to_path(path)
