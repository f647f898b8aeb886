"""The object behind a log or progress function; the extension module calls it from the library's threads."""

from __future__ import annotations

from typing import Any, Callable, Optional


class Callback:
    """A function, and what it raised. The module holds it weakly: it works as long as its owner keeps it."""

    __slots__ = ("__weakref__", "error", "function")

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.error: Optional[BaseException] = None

    def __call__(self, *arguments: Any) -> None:
        # After the first error the function is left alone: the operation is about to end.
        if self.error is None:
            self.function(*arguments)

    def take_error(self) -> Optional[BaseException]:
        """The error, which is forgotten."""
        error, self.error = self.error, None
        return error


def check_callable(value: Any, name: str) -> None:
    if value is not None and not callable(value):
        raise TypeError(f"{name}: expected a function or None, got {type(value).__name__}")
