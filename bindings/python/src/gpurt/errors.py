"""What gpurt raises: one class for each result code of the C library.

Each class is also the built-in exception that Python programmers would expect, so ``except ValueError`` or
``except MemoryError`` catch what they should.
"""

from __future__ import annotations


class Error(Exception):
    """Any failure that gpurt reports. The text tells the cause and the remedy."""


class InvalidArgument(Error, ValueError):
    """An argument, or its combination with others, is wrong; the text names it."""


class OutOfMemory(Error, MemoryError):
    """The machine's memory, or the device's memory limit, does not suffice."""


class Unsupported(Error, NotImplementedError):
    """This build, version or device cannot do it."""


class Cancelled(Error):
    """The job was cancelled. Its frame keeps the whole samples that were done."""


class DeviceError(Error, RuntimeError):
    """There is no such device, its driver failed, or a fault ended the process' work on it."""


class Timeout(Error, TimeoutError):
    """The time to wait is over and the job still runs."""


class FileError(Error, OSError):
    """A file is missing, damaged or cannot be written; the text names it."""


class InternalError(Error, RuntimeError):
    """An error of gpurt's own. Please report it."""
