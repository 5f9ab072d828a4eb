"""Results as tables, in a notebook by themselves and for pandas, and as plain data for JSON."""

import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from html import escape
from math import isfinite, pi
from textwrap import shorten
from typing import Any, Generic, TypeVar

from ambid.errors import InputError, UnknownParameterError, did_you_mean

T = TypeVar("T")
SHORT = 120
"""Characters of a sentence in a `repr`, at the most."""
READABLE = {"1": (100.0, "%"), "m": (1e3, "mm"), "rad": (180.0 / pi, "degrees"), "s": (1e6, "us")}
"""Factor and unit of small numbers by their SI unit."""


class Named(dict[str, T]):
    """Values by name; a name that is none is refused with what comes nearest.

    Raises
    ------
    UnknownParameterError
        Which is a KeyError, too.
    """

    def __missing__(self, name: str) -> T:
        near = did_you_mean(str(name), self)
        raise UnknownParameterError(f"{name}: no such name; {near}there are {', '.join(self) or 'none'}")


def named(values: Mapping[str, Any]) -> Named[Any]:
    """Values by name, and such in them likewise."""
    return Named({name: named(own) if isinstance(own, dict) else own for name, own in values.items()})


class OfParameters(Generic[T]):
    """A result that is asked for its parameters by name, as in ``result["tau_e"]`` and ``"tau_e" in result``."""

    parameters: dict[str, T]

    def __getitem__(self, name: str) -> T:
        """What was found of a parameter, such as ``estimate["K_i.A_zeta"]``."""
        return self.parameters[name]

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    def __iter__(self) -> Iterator[str]:
        return iter(self.parameters)


class Tabular(ABC):
    """A result that has rows and columns; what it holds by name is `Named`.

    Its `repr` is the first sentence of its summary; `print` shows all of it.
    """

    def __post_init__(self) -> None:
        for name, own in vars(self).items():
            if isinstance(own, dict):
                object.__setattr__(self, name, named(own))

    @abstractmethod
    def table(self) -> dict[str, list[Any]]:
        """Columns of equal length by name, SI units."""

    @abstractmethod
    def summary(self) -> list[str]:
        """What a reader of the table must know beside it, a sentence each."""

    def to_pandas(self) -> Any:
        """Convert `table` to a pandas.DataFrame.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        return data_frame(self.table())

    def __repr__(self) -> str:
        return f"{type(self).__name__}({shorten(self.summary()[0], SHORT, placeholder=' ...')})"

    def __str__(self) -> str:
        return "\n".join(self.summary())

    def _repr_html_(self) -> str:
        columns = self.table()
        return html_table(list(columns), zip(*columns.values(), strict=True), self.summary())


def html_table(head: Sequence[str], rows: Iterable[Sequence[Any]], said: Sequence[str] = ()) -> str:
    """A table of a notebook, with sentences under it."""
    columns = "".join(f"<th>{escape(name)}</th>" for name in head)
    cells = ("".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    below = "".join(f"<p>{escape(line)}</p>" for line in said)
    return f"<table><thead><tr>{columns}</tr></thead><tbody>{body}</tbody></table>{below}"


def data_frame(columns: Mapping[str, Any]) -> Any:
    """A pandas.DataFrame of columns of equal length by name.

    Raises
    ------
    InputError
        If pandas is not installed.
    """
    try:
        pandas = importlib.import_module("pandas")
    except ImportError:
        raise InputError("to_pandas needs the package pandas: pip install pandas") from None
    return pandas.DataFrame(columns)


Opener = Callable[[], Any]
"""Opens the room of the pictures."""
_DOOR: list[Opener] = []
PICTURES: set[str] = set()
"""Functions of the room of the pictures that results are drawn by."""


def pictures_by(opener: Opener) -> None:
    """Register what opens the room of the pictures: `ambid` does, which stands above all rooms."""
    _DOOR[:] = [opener]


def picture(name: str) -> Callable[..., Any]:
    """A method that draws a result by the function of this name in `ambid.plot`, which is opened when it is called."""

    def draw(result: object, *args: Any, **kwargs: Any) -> Any:
        return getattr(_DOOR[0](), name)(result, *args, **kwargs)

    PICTURES.add(name)
    draw.__name__ = draw.__qualname__ = name
    draw.__doc__ = f"Draw it: `ambid.plot.{name}`, with the same arguments."
    return draw


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def of_unit(unit: str) -> str:
    """What stands behind a number: a space and its unit, nothing behind a ratio."""
    return "" if unit == "1" else f" {unit}"


def readable(value: float, unit: str) -> str:
    """A length, an angle, an instant or a ratio in the unit that is read most easily, with its sign: ``+0.31 mm``."""
    factor, name = READABLE.get(unit, (1.0, unit))
    return f"{factor * value:+.3g} {name}"


def band_text(low: float, high: float, between: str = " .. ") -> str:
    """From and to of a band [Hz], with so many digits that they differ."""
    digits = 0 if high >= 99.5 or high - low >= 9.95 else 1 if high >= 9.95 else 2
    return f"{low:.{digits}f}{between}{high:.{digits}f}"


def speed_text(speed: float) -> str:
    """A speed of rotation [rad/s], in rpm too."""
    return f"{speed:g} rad/s ({speed * 30.0 / pi:.0f} rpm)"


def plain(value: Any) -> Any:
    """Make strict JSON of nested data: null for a number that is not finite, [re, im] of a complex one."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):  # one of NumPy's too
        return float(value) if isfinite(value) else None
    return value
