"""MATLAB files of version 5 and 4. SciPy's parser trusts them, so that their structure is gone through first."""

from __future__ import annotations

import math
import mmap
import struct
import zlib
from pathlib import Path
from typing import Any

import scipy.io

from ambid.reading.sizes import SHARE_OF_MEMORY, memory_limit

__all__ = ["load_mat"]

DEEPEST = 50
"""Cells and structures within each other; the parser's stack ends at some thousands, and the process with it."""
MOST_ARRAYS = 100_000
"""Arrays of one file, cells and members of structures counted; a record has some ten, and each takes microseconds."""
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_LETTERS = _NUMBERS | {16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_LARGEST_CLASS = 15
_MOST_DIMENSIONS = 32
_HEADER = 128


def load_mat(path: Path) -> dict[str, Any]:
    """Variables of a .mat file of version 5 or 4, as `scipy.io.loadmat` makes them.

    Raises
    ------
    ValueError
        If the file is no such file, nests deeper than `DEEPEST`, declares more than it holds, or expands to more
        than is read on this machine.
    Exception
        Whatever else SciPy's parser raises; call it within `reading`.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER)
        is_little = head[126:128] == b"IM"
        # Version 4 begins with a small number; 7.3 is HDF5, which the parser refuses by itself.
        if len(head) == _HEADER and 0 not in head[:4] and head[125 if is_little else 124] == 1:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                _Structure("<" if is_little else ">").require_sound(data)
    return {name: v for name, v in scipy.io.loadmat(path, appendmat=False).items() if not name.startswith("__")}


class _Structure:
    """The tags of a file, gone through without reading a value."""

    def __init__(self, order: str) -> None:
        self._u32 = struct.Struct(f"{order}I")
        self._order = order
        self._room = int(SHARE_OF_MEMORY * memory_limit())
        self._arrays = 0

    def require_sound(self, data: mmap.mmap) -> None:
        """Raise ValueError where the tags do not fit into each other, or hold too much."""
        at = _HEADER
        while at < len(data):
            kind, start, size, _ = self._tag(data, at, len(data))
            if kind == _COMPRESSED:
                held = self._expanded(data[start : start + size])
                inner, first, length, _ = self._tag(held, 0, len(held))
                self._require(inner == _MATRIX, f"element {inner} in a compressed variable")
                self._matrix(held, first, first + length, 0)
            else:
                self._require(kind == _MATRIX, f"element {kind} at byte {at}")
                self._matrix(data, start, start + size, 0)
            at = start + size

    def _expanded(self, packed: bytes) -> bytes:
        expander = zlib.decompressobj()
        held = expander.decompress(packed, self._room)
        self._require(not expander.unconsumed_tail, f"a variable expands to more than {self._room:.3g} bytes")
        self._room -= len(held)
        return held

    def _matrix(self, data: Any, at: int, end: int, depth: int) -> None:
        """An array from its flags on; what it declares must fill it, since the parser does not look at its end."""
        self._arrays += 1
        self._require(self._arrays <= MOST_ARRAYS, f"more than {MOST_ARRAYS} arrays")
        self._require(depth <= DEEPEST, f"cells or structures nested deeper than {DEEPEST}")
        if at == end:
            return
        _, flags, size, at = self._tag(data, at, end)
        self._require(size == 8, "damaged flags of an array")
        own = self._u32.unpack_from(data, flags)[0]
        kind, is_complex = own & 0xFF, bool(own >> 11 & 1)
        if kind == _OPAQUE:
            for _ in range(3):
                _, at = self._element(data, at, end, _NUMBERS)
            self._inner(data, at, end, 1, depth)
            return
        dimensions, at = self._integers(data, at, end)
        self._require(2 <= len(dimensions) <= _MOST_DIMENSIONS, f"an array of {len(dimensions)} dimensions")
        self._require(min(dimensions) >= 0, f"an array of shape {dimensions}")
        _, at = self._element(data, at, end, _NUMBERS)  # its name
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
            self._require(_CHAR <= kind <= _LARGEST_CLASS, f"an array of class {kind}")
            parts = (2 if kind == _SPARSE else 0) + 1 + is_complex
            for _ in range(parts):
                _, at = self._element(data, at, end, _LETTERS if kind == _CHAR else _NUMBERS)
            self._require(at == end or depth == 0, "an array that does not fill its element")

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
