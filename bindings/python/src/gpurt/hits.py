"""Hits in arrays of PyTorch, CuPy, JAX and others, which have no structured types."""

from __future__ import annotations

from typing import Any, Iterable, Tuple

from gpurt._libraries import Library

_FLOATS = ("t", "u", "v")
_IDS = ("primitive", "geometry", "instance")


class Hits:
    """Hits as a query left them: `packed` is a float32 array [...][8], or [...][4] for compact hits, of the library
    and on the device of the rays.

    hits.t, hits.u, hits.v, hits.primitive, hits.geometry and hits.instance are its columns, [...]; hits["t"] is the
    same. Those of PyTorch and CuPy are views. The ids are uint32, of PyTorch int32: a miss is 0xFFFFFFFF or -1.
    """

    __slots__ = ("_library", "packed")

    def __init__(self, library: Library, packed: Any) -> None:
        self._library = library
        self.packed = packed

    @property
    def names(self) -> Tuple[str, ...]:
        return (_FLOATS + _IDS) if self.packed.shape[-1] == 8 else (*_FLOATS, "primitive")

    @property
    def shape(self) -> Tuple[int, ...]:
        return tuple(self.packed.shape[:-1])

    def __getitem__(self, name: str) -> Any:
        if name not in self.names:
            raise KeyError(f"{name!r} is none of {', '.join(map(repr, self.names))}")
        dtype = "float32" if name in _FLOATS else self._library.id_dtype
        return self._library.column(self.packed, self.names.index(name), dtype)

    def __getattr__(self, name: str) -> Any:
        if name in _FLOATS or name in _IDS:
            try:
                return self[name]
            except KeyError:
                raise AttributeError(f"compact hits have no {name}; use format='full'") from None
        raise AttributeError(name)

    def __dir__(self) -> Iterable[str]:
        return [*object.__dir__(self), *self.names]

    def __len__(self) -> int:
        if not self.shape:
            raise TypeError("the hit of a single ray has no length")
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<gpurt.Hits {list(self.shape)} of {type(self.packed).__module__.partition('.')[0]}: " \
               f"{', '.join(self.names)}>"
