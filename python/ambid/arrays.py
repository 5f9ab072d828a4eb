"""Types of the arrays that pass between rooms, and when what holds arrays is the same."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IndexArray = NDArray[np.intp]
StateSpace = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""A, B, C, D."""


class ByValue:
    """A dataclass that holds arrays: two are equal whose fields are, NaN being NaN; declare it with ``eq=False``.

    Attributes
    ----------
    incidental : tuple of str
        Fields that do not count, such as the seconds that it took.
    read_only : tuple of str
        Arrays that nobody can change.
    """

    incidental: ClassVar[tuple[str, ...]] = ()
    read_only: ClassVar[tuple[str, ...]] = ()

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self is other or all(
            is_same(own, its) for own, its in zip(self._counted(), other._counted(), strict=True)
        )

    def __hash__(self) -> int:
        """Of what is hashed soon: names and numbers among the fields; every NaN has a hash of its own."""
        return hash(
            (type(self), *(own for own in self._counted() if isinstance(own, str | int | float) and own == own))
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """As it was; a copy of an array that could not be written cannot be either."""
        self.__dict__.update(state)
        for name in self.read_only:
            if (own := getattr(self, name)) is not None:
                own.flags.writeable = False

    def _counted(self) -> tuple[Any, ...]:
        return tuple(getattr(self, f.name) for f in fields(self) if f.name not in self.incidental)  # type: ignore[arg-type]


def stacked(lines: ComplexArray) -> FloatArray:
    """Real and imaginary parts, one below the other."""
    return np.concatenate([lines.real, lines.imag])


def is_same(a: Any, b: Any) -> bool:
    """Whether two values are equal, whatever arrays they hold; NaN is NaN."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, type(b)) and a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind in "fc")
    if isinstance(a, float) and isinstance(b, float):
        return a == b or (a != a and b != b)
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return list(a) == list(b) and all(is_same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return type(a) is type(b) and len(a) == len(b) and all(map(is_same, a, b))
    if type(a).__eq__ is ByValue.__eq__ or not is_dataclass(a) or type(a) is not type(b):
        return bool(a == b)
    return all(is_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a) if f.compare)
