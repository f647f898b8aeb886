"""Devices: where scenes live and work is done."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import threading
import weakref
from typing import Any, Callable, Iterator, List, NoReturn, Optional, Sequence, Union

import numpy as np

from gpurt import _core
from gpurt._arrays import to_count
from gpurt._callbacks import Callback, check_callable
from gpurt._names import DEVICE_TYPE, LOG_LEVEL
from gpurt.errors import InvalidArgument

LogFunction = Callable[[str, str], Any]


@dataclasses.dataclass(frozen=True)
class DeviceProperties:
    """What a device is, and how much memory it holds."""

    type: str  #: "cpu" or "cuda"
    ordinal: int  #: which CUDA device
    num_threads: int  #: worker threads of the CPU, multiprocessors of a GPU
    memory_bytes: int  #: physical memory
    memory_limit: int  #: bytes; 0: none
    memory_used: int  #: bytes held now by scenes, frames and jobs of this device object
    memory_peak: int  #: the largest that memory_used has been
    compute_capability: int  #: 90 for 9.0; 0 for a CPU
    name: str
    instruction_set: str  #: the variant in use, such as "x86_64_v3" or "sm_90"


def _properties(values: Any) -> DeviceProperties:
    return DeviceProperties(**{**values, "type": DEVICE_TYPE.name(values["type"])})


def _log_to_logging(level: str, message: str) -> None:
    logging.getLogger("gpurt").log(getattr(logging, level.upper(), logging.INFO), "%s", message)


def refuse_pickling(name: str, instead: str) -> NoReturn:
    raise TypeError(f"cannot pickle {name}: it belongs to this process; {instead}")


class Device:
    """A CPU or a GPU with the memory and the threads that gpurt uses on it.

    :param type: "auto" (the first CUDA device that works, else the CPU), "cpu" or "cuda".
    :param ordinal: which CUDA device, from 0; or several, such as (0, 1): they work as one. A scene is built on each,
        and they share the work of every frame and of rays in host memory. The bits are those of one device.
    :param threads: worker threads of the CPU; 0: all that the process may use.
    :param memory_limit: bytes that scenes, frames and working memory may take together, on each device; 0: no limit.
    :param log: called as log(level, message) with level "error", "warning" or "info", from any thread, never from
        two at once. It must not use gpurt. What it raises is raised by the gpurt call that runs, or the next one.
        None: messages go to logging.getLogger("gpurt").

    Scenes keep their device alive. Devices can be used from several threads.

    Raises InvalidArgument; Unsupported for a GPU that the build or its age rules out; DeviceError where there is no
    such device or its driver fails.
    """

    def __init__(self, type: str = "auto", ordinal: Union[int, Sequence[int]] = 0, threads: int = 0, memory_limit: int = 0,
                 log: Optional[LogFunction] = None) -> None:
        check_callable(log, "log")
        function = log or _log_to_logging
        self._log = Callback(lambda level, message: function(LOG_LEVEL.name(level), message))
        several: Sequence[int] = [ordinal] if isinstance(ordinal, (int, np.integer)) else list(ordinal)
        if not several:
            raise InvalidArgument("ordinal: is empty; name at least one device")
        ordinals = [to_count(n, "ordinal") for n in several]
        with self._log_errors():
            self._core = _core.Device(DEVICE_TYPE.value(type), ordinals,
                                      to_count(threads, "threads"), to_count(memory_limit, "memory_limit", 64),
                                      self._log)
        found = self._core.properties()
        self._is_cuda = DEVICE_TYPE.name(found["type"]) == "cuda"
        self._ordinals = tuple(ordinals) if len(ordinals) > 1 else (int(found["ordinal"]),)

    @property
    def properties(self) -> DeviceProperties:
        """What the device is and how much memory it holds now."""
        return _properties(self._core.properties())

    @contextlib.contextmanager
    def _log_errors(self) -> Iterator[None]:
        """Raises what the log function raised, during or since the last call."""
        try:
            yield
        finally:
            error = self._log.take_error()
            if error is not None:
                raise error

    def __repr__(self) -> str:
        p = self.properties
        kind = p.type if p.type == "cpu" else f"{p.type}:{','.join(map(str, self._ordinals))}"
        return f"<gpurt.Device {kind}, {p.name}, {p.memory_used / 2**20:.1f} MiB in use>"

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.Device", "make a device of its own in the other process")


def devices() -> List[DeviceProperties]:
    """The devices of this machine: the CPU first, then GPUs by ordinal.

    Never fails for want of a driver: without one there are no GPUs.
    """
    return [_properties(p) for p in _core.devices()]


_default: Callable[[], Optional[Device]] = lambda: None
_default_lock = threading.Lock()


def default_device() -> Device:
    """The device of scenes that name none: Device() with its defaults, shared as long as something uses it."""
    global _default
    with _default_lock:
        device = _default()
        if device is None:
            device = Device()
            _default = weakref.ref(device)
        return device
