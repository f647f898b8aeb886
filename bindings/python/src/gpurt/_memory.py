"""Memory of other libraries' arrays, through DLPack or the CUDA array interface, and memory lent to them."""

from __future__ import annotations

from typing import Any, Dict, Optional, Sequence, Tuple

import numpy as np
import numpy.typing as npt

from gpurt import _core
from gpurt._arrays import HOST_DEVICES, shape_text
from gpurt.errors import InvalidArgument

# Types of devices, as DLPack numbers them.
CPU, CUDA, CUDA_HOST, CUDA_MANAGED = 1, 2, 3, 13
#: What a GPU's queries read and write: its own memory, and what it shares with the host.
ON_GPU = (CUDA, CUDA_MANAGED)
_PLACES = {CPU: "host memory", CUDA: "CUDA device {}", CUDA_HOST: "pinned host memory", CUDA_MANAGED: "managed memory"}

#: CUDA's legacy default stream, as DLPack and CUDA number it.
DEFAULT_STREAM = 1

_CODES = {0: "int", 1: "uint", 2: "float", 4: "bfloat", 5: "complex"}


def _dtype_name(dtype: Tuple[int, int, int]) -> str:
    code, bits, lanes = dtype
    name = "bool" if code == 6 else f"{_CODES.get(code, f'type {code} of bits ')}{bits}"
    return name if lanes == 1 else f"{name} x {lanes}"


def place_text(device: Tuple[int, int]) -> str:
    return _PLACES.get(device[0], f"a device of DLPack type {device[0]}").format(device[1])


class View:
    """Where the elements of an array lie. The array's memory is held while this lives.

    `strides` are in elements; `device` is (type, id) as in DLPack; `stream` is the one that elements are ready on.
    """

    def __init__(self, name: str, data: int, device: Tuple[int, int], dtype: str, itemsize: int, shape: Tuple[int, ...],
                 strides: Optional[Tuple[int, ...]], read_only: bool, stream: Optional[int], owner: Any) -> None:
        self.name, self.data, self.device, self.dtype, self.itemsize = name, data, device, dtype, itemsize
        self.shape, self.strides, self.read_only, self.stream = shape, strides, read_only, stream
        self.owner = owner

    @property
    def on_host(self) -> bool:
        return self.device[0] in HOST_DEVICES

    @property
    def size(self) -> int:
        size = 1
        for n in self.shape:
            size *= n
        return size

    def is_packed(self, first_axis: int = 0) -> bool:
        """Whether the axes from first_axis on follow each other without gaps, the last one fastest."""
        if self.strides is None or self.size == 0:
            return True
        expected = 1
        for n, stride in zip(reversed(self.shape[first_axis:]), reversed(self.strides[first_axis:])):
            if n != 1 and stride != expected:
                return False
            expected *= n
        return True

    def __str__(self) -> str:
        return f"{self.dtype} {shape_text(self.shape)} in {self.place}"

    @property
    def place(self) -> str:
        return f"the memory of {place_text(self.device)}" if self.device[0] == CUDA else place_text(self.device)

    def refuse(self, problem: str, remedy: str) -> InvalidArgument:
        return InvalidArgument(f"{self.name}: {problem}, got {self}; {remedy}")


def has_dlpack(value: Any) -> bool:
    return hasattr(value, "__dlpack__") and hasattr(value, "__dlpack_device__")


def device_of(value: Any) -> Tuple[int, int]:
    """(type, id) as in DLPack."""
    if has_dlpack(value):
        kind, index = value.__dlpack_device__()
        return int(kind), int(index)
    return CUDA, 0


def numpy_view(array: npt.NDArray[Any], name: str) -> View:
    strides = tuple(stride // array.itemsize for stride in array.strides)
    return View(name, array.ctypes.data, (CPU, 0), str(array.dtype), array.itemsize, array.shape, strides,
                not array.flags.writeable, None, array)


def view(value: Any, name: str, stream: Optional[int] = None) -> View:
    """The memory of an array. On a GPU its elements are ready for work that is queued on `stream` from now on."""
    if has_dlpack(value):
        on_device = device_of(value)[0] not in HOST_DEVICES
        return _dlpack_view(value, name, stream if on_device else None)
    return _cuda_array_view(value, name)


def _dlpack_view(value: Any, name: str, stream: Optional[int]) -> View:
    try:
        try:
            capsule = value.__dlpack__(stream=stream, max_version=(1, 0))
        except TypeError:  # older than version 1
            capsule = value.__dlpack__(stream=stream)
        tensor = _core.BorrowedTensor(capsule)
    except (AttributeError, BufferError, RuntimeError, TypeError, ValueError) as error:
        raise InvalidArgument(f"{name}: cannot be read through DLPack: {error}") from error
    dtype = tensor.dtype()
    return View(name, tensor.data(), tensor.device(), _dtype_name(dtype), dtype[1] * dtype[2] // 8, tensor.shape(),
                tensor.strides(), tensor.read_only(), stream, tensor)


def _cuda_array_view(value: Any, name: str) -> View:
    """Of an object that has the CUDA array interface alone. It names the stream that its elements are ready on."""
    interface: Dict[str, Any] = value.__cuda_array_interface__
    dtype = np.dtype(interface["typestr"])
    if interface.get("mask") is not None:
        raise InvalidArgument(f"{name}: has a mask; fill or remove masked elements")
    data, read_only = interface["data"]
    strides = interface.get("strides")
    if strides is not None:
        if any(stride % dtype.itemsize for stride in strides):
            raise InvalidArgument(f"{name}: has strides {tuple(strides)} that are no multiples of {dtype.itemsize} bytes")
        strides = tuple(stride // dtype.itemsize for stride in strides)
    # The interface does not say which device it is; the library finds out from the address.
    return View(name, int(data or 0), (CUDA, 0), str(dtype), dtype.itemsize, tuple(interface["shape"]), strides,
                bool(read_only), int(interface.get("stream") or DEFAULT_STREAM), value)


class DeviceArray:
    """A packed array in memory of gpurt, for any library that takes DLPack or, from a GPU, the CUDA array interface:
    torch.from_dlpack(array), cupy.asarray(array), jax.numpy.from_dlpack(array), numpy.from_dlpack(array).

    The memory lives as long as this object or an array that was made from it.
    """

    def __init__(self, device: _core.Device, place: Tuple[int, int], shape: Sequence[int], dtype: str,
                 needs: Any = None) -> None:
        self._device = device
        self._place = place
        self.shape: Tuple[int, ...] = tuple(shape)
        self.dtype = np.dtype(dtype)
        self.nbytes = int(np.prod(self.shape, dtype=np.int64)) * self.dtype.itemsize
        # What queued work reads goes no sooner than what it writes.
        self._needs = needs
        self._is_queued = False
        self._buffer = _core.Buffer(device, place[0] == CUDA, max(self.nbytes, 1), 0, None)

    @property
    def data(self) -> int:
        """The address of the first element."""
        return self._buffer.data()

    def last(self) -> int:
        """The last element, of an array of integers."""
        size = self.dtype.itemsize
        return int(np.frombuffer(self._buffer.read(self.nbytes - size, size), self.dtype)[0])

    def mark_queued(self) -> None:
        """Work that writes the array is on the default stream."""
        self._is_queued = True

    def __del__(self) -> None:
        # The work's inputs are this object's to keep: they must not go before it is done.
        if getattr(self, "_is_queued", False) and self._needs is not None:
            try:
                self._device.wait_for_stream(self._place[1], DEFAULT_STREAM)
            except Exception:
                pass  # nobody to tell; a failed device fails the next call

    def __dlpack_device__(self) -> Tuple[int, int]:
        return self._place

    def __dlpack__(self, *, stream: Optional[int] = None, max_version: Optional[Tuple[int, int]] = None,
                   dl_device: Optional[Tuple[int, int]] = None, copy: Optional[bool] = None) -> Any:
        if dl_device is not None and tuple(map(int, dl_device)) != self._place:
            raise BufferError(f"the array lies in {place_text(self._place)}; it cannot be handed out elsewhere")
        if copy:
            raise BufferError("the array is handed out as it is; copy it afterwards")
        if self._place[0] == CUDA and stream != -1:
            self._order(DEFAULT_STREAM if stream is None else int(stream))
        code = {"f": 2, "i": 0, "u": 1, "b": 6}[self.dtype.kind]
        return _core.lend_tensor(self, self.data, list(self.shape), code, 8 * self.dtype.itemsize, *self._place,
                                 max_version is not None and max_version[0] >= 1)

    def _order(self, stream: int) -> None:
        if stream != DEFAULT_STREAM:
            self._device.order_streams(self._place[1], stream, DEFAULT_STREAM)

    @property
    def __cuda_array_interface__(self) -> Dict[str, Any]:
        if self._place[0] != CUDA:
            raise AttributeError("the array lies in host memory")
        return {"shape": self.shape, "typestr": self.dtype.str, "data": (self.data, False), "version": 3,
                "stream": DEFAULT_STREAM}

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> Any:
        if self._place[0] != CUDA:
            array = np.from_dlpack(self)
            return array if dtype is None or array.dtype == dtype else array.astype(dtype)
        if copy is False:
            raise ValueError("the array lies in device memory: numpy needs a copy")
        array = np.frombuffer(self._buffer.read(0, self.nbytes), self.dtype).reshape(self.shape)
        return array if dtype is None else array.astype(dtype)

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("a single value has no length")
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<gpurt.DeviceArray {self.dtype} {shape_text(self.shape)} in {place_text(self._place)}>"
