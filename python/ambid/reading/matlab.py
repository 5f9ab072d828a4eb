"""MATLAB files of version 5 and 4. SciPy's parser trusts them, so that their structure is gone through first."""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io

from ambid.reading.guard import most_bytes

DEEPEST = 50
"""Cells and structures within each other; the parser's stack ends at some thousands, and the process with it."""
MOST_ARRAYS = 100_000
"""Arrays of one file, cells and members of structures counted; a record has some ten, and each takes microseconds."""
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_LETTERS = _NUMBERS | {16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_TYPES = dict(zip(range(6, 16), ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), strict=True))
_MOST_DIMENSIONS = 32
_HEADER = 128
_HEAD_OF_VARIABLE = 512
"""Bytes with flags, dimensions and name of a variable: these take 300 at most."""


@dataclass(frozen=True)
class Variable:
    """What a file says of a variable before it is read; `dtype` is None where it is no array of numbers."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any] | None


def variables_of(path: Path) -> list[Variable] | None:
    """The variables of a file of version 5; None of another version. Raises as `load_mat` does."""
    with _structure(path) as structure:
        return None if structure is None else [variable for variable, _ in structure.variables()]


def load_mat(path: Path, names: Collection[str] | None = None) -> dict[str, Any]:
    """Variables of a .mat file of version 5 or 4, as `scipy.io.loadmat` makes them; all, or those of `names`.

    Raises
    ------
    ValueError
        If the file is no such file, nests deeper than `DEEPEST`, declares more than it holds, or expands to more
        than is read on this machine.
    Exception
        Whatever else SciPy's parser raises; call it within `reading`.
    """
    with _structure(path) as structure:
        if structure is not None:
            structure.require_sound(names)
    found = scipy.io.loadmat(path, appendmat=False, variable_names=names)
    return {name: value for name, value in found.items() if not name.startswith("__")}


@contextmanager
def _structure(path: Path) -> Iterator[_Structure | None]:
    with path.open("rb") as file:
        head = file.read(_HEADER)
        is_little = head[126:128] == b"IM"
        # Version 4 begins with a small number; 7.3 is HDF5, which the parser refuses by itself.
        if len(head) < _HEADER or 0 in head[:4] or head[125 if is_little else 124] != 1:
            yield None
            return
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            yield _Structure(data, "<" if is_little else ">")


class _Structure:
    """The tags of a file, gone through without reading a value."""

    def __init__(self, data: mmap.mmap, order: str) -> None:
        self._data, self._order = data, order
        self._u32 = struct.Struct(f"{order}I")
        self._room = most_bytes()
        self._arrays = 0

    def variables(self) -> Iterator[tuple[Variable, tuple[int, int, int]]]:
        """Each variable, with kind, begin and size of its element."""
        at = _HEADER
        while at < len(self._data):
            kind, start, size, _ = self._tag(self._data, at, len(self._data))
            head: Any = self._data[start : start + min(size, _HEAD_OF_VARIABLE)]
            if kind == _COMPRESSED:
                packed = self._data[start : start + min(size, 1 << 16)]
                head = zlib.decompressobj().decompress(packed, _HEAD_OF_VARIABLE)
                inner, length = struct.unpack_from(f"{self._order}II", head.ljust(8, b"\0"))
                self._require(inner == _MATRIX, f"element {inner} in a compressed variable")
                self._require(length <= most_bytes(), f"a variable of {length:.3g} bytes; fewer are read here")
                head = head[8:]
            else:
                self._require(kind == _MATRIX, f"element {kind} at byte {at}")
            yield self._variable(head), (kind, start, size)
            at = start + size

    def _variable(self, head: bytes) -> Variable:
        own, is_complex, shape, (first, length), _ = self._head(head, 0, len(head))
        dtype = np.dtype(complex if is_complex else _TYPES[own]) if own in _TYPES else None
        return Variable(head[first : first + length].decode("latin1"), shape, dtype)

    def require_sound(self, names: Collection[str] | None) -> None:
        """Raise ValueError where the tags of these variables do not fit into each other, or hold too much."""
        for variable, (kind, start, size) in self.variables():
            if names is not None and variable.name not in names:
                continue
            if kind == _COMPRESSED:
                held = self._expanded(self._data[start : start + size])
                _, first, length, _ = self._tag(held, 0, len(held))
                self._matrix(held, first, first + length, 0)
            else:
                self._matrix(self._data, start, start + size, 0)

    def _expanded(self, packed: bytes) -> bytes:
        expander = zlib.decompressobj()
        held = expander.decompress(packed, self._room)
        self._require(not expander.unconsumed_tail, "variables that expand to more than is read here")
        self._room -= len(held)
        return held

    def _matrix(self, data: Any, at: int, end: int, depth: int) -> None:
        """An array from its flags on; what it declares must fill it, since the parser does not look at its end."""
        self._arrays += 1
        self._require(self._arrays <= MOST_ARRAYS, f"more than {MOST_ARRAYS} arrays")
        self._require(depth <= DEEPEST, f"cells or structures nested deeper than {DEEPEST}")
        if at == end:
            return
        kind, is_complex, dimensions, _, at = self._head(data, at, end)
        if kind == _OPAQUE:
            for _ in range(3):
                _, at = self._element(data, at, end, _NUMBERS)
            self._inner(data, at, end, 1, depth)
            return
        entries = math.prod(dimensions)
        if kind in (_CELL, _FUNCTION):
            self._inner(data, at, end, entries if kind == _CELL else 1, depth)
        elif kind in (_STRUCT, _OBJECT):
            if kind == _OBJECT:
                _, at = self._element(data, at, end, _NUMBERS)
            lengths, at = self._integers(data, at, end)
            self._require(len(lengths) == 1 and lengths[0] > 0, "a structure without names")
            size, at = self._element(data, at, end, _NUMBERS)
            self._inner(data, at, end, entries * (size // lengths[0]), depth)
        else:
            self._require(_CHAR <= kind <= max(_TYPES), f"an array of class {kind}")
            parts = (2 if kind == _SPARSE else 0) + 1 + is_complex
            for _ in range(parts):
                _, at = self._element(data, at, end, _LETTERS if kind == _CHAR else _NUMBERS)
            self._require(at == end or depth == 0, "an array that does not fill its element")

    def _head(self, data: Any, at: int, end: int) -> tuple[int, bool, tuple[int, ...], tuple[int, int], int]:
        """Class, whether it is complex, dimensions, place and length of the name, and where the rest begins."""
        _, flags, size, at = self._tag(data, at, end)
        self._require(size == 8, "damaged flags of an array")
        own = self._u32.unpack_from(data, flags)[0]
        kind = own & 0xFF
        if kind == _OPAQUE:
            return kind, False, (), (0, 0), at
        dimensions, at = self._integers(data, at, end)
        self._require(2 <= len(dimensions) <= _MOST_DIMENSIONS, f"an array of {len(dimensions)} dimensions")
        self._require(min(dimensions) >= 0, f"an array of shape {dimensions}")
        letters, first, length, at = self._tag(data, at, end)
        self._require(letters in _NUMBERS, f"element {letters} for a name")
        return kind, bool(own >> 11 & 1), dimensions, (first, length), at

    def _inner(self, data: Any, at: int, end: int, count: int, depth: int) -> None:
        """The arrays within a cell or structure; each takes 8 bytes at least."""
        self._require(count <= (end - at) // 8, f"{count} cells in {end - at} bytes")
        for _ in range(count):
            kind, start, size, after = self._tag(data, at, end)
            self._require(kind == _MATRIX, f"element {kind} for a cell")
            self._matrix(data, start, start + size, depth + 1)
            at = after

    def _integers(self, data: Any, at: int, end: int) -> tuple[tuple[int, ...], int]:
        kind, start, size, after = self._tag(data, at, end)
        self._require(kind in (5, 6) and size <= 4 * _MOST_DIMENSIONS, "damaged dimensions of an array")
        return struct.unpack_from(f"{self._order}{size // 4}i", data, start), after

    def _element(self, data: Any, at: int, end: int, kinds: frozenset[int]) -> tuple[int, int]:
        kind, _, size, after = self._tag(data, at, end)
        self._require(kind in kinds, f"element {kind} for the values of an array")
        return size, after

    def _tag(self, data: Any, at: int, end: int) -> tuple[int, int, int, int]:
        """Kind of an element, where its values begin, how many bytes they take, and where the next one begins."""
        self._require(at + 8 <= end, "an element beyond its end")
        kind = self._u32.unpack_from(data, at)[0]
        if kind >> 16:  # both in one word, and up to four bytes of values in the next
            size = kind >> 16
            self._require(size <= 4, f"a short element of {size} bytes")
            return kind & 0xFFFF, at + 4, size, at + 8
        size = self._u32.unpack_from(data, at + 4)[0]
        start = at + 8
        self._require(start + size <= end, f"an element of {size} bytes where {end - start} are left")
        return kind, start, size, min(end, start + -(-size // 8) * 8)

    @staticmethod
    def _require(sound: bool, found: str) -> None:
        if not sound:
            raise ValueError(found)
