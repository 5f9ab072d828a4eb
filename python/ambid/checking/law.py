"""The law that a controller runs, found from its own recorded input and command, whatever the rig file says of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.record import Record
from ambid.record.checks import at_limits
from ambid.record.rebuild import unexplained
from ambid.rig import Rig

__all__ = ["Law", "find_laws"]

MOST_LAGS = 4
"""Commands before that a recursion may hold on to: an integrator, and filters of third order."""
BETTER = 0.3
"""Part of what is left to which a law with more numbers must bring it to be preferred."""
EXACT = 1e-6
"""Part of the command below which what is left is rounding of what was logged, and the shortest law is taken."""
ROUNDING = 1e-6
"""Share in the largest term of a recursion below which a term is rounding, and not told."""
ALIKE = 0.05
"""Part of the command up to which a law counts as found."""
TOLD = 3.0
"""Standard errors that a gain must have to be told."""


@dataclass(frozen=True)
class Law:
    """What one axis of a controller does, in its recorded samples.

    Attributes
    ----------
    axis : str
    text : str
        Such as ``u = 38 e + 188 int e + 1.92 de/dt``, e = r - y (or -y), else its recursion.
    gains : dict of str to float
        Factors of the terms of `text`.
    std_error : dict of str to float
        Of these.
    left : float
        Rms of what it leaves from sample to sample, over that of the command without its mean.
    rig_left : float
        The same of the rig's controller.
    clipped : float
        Part of the samples in which the command stood at its highest or lowest; they are left aside.
    """

    axis: str
    text: str
    gains: dict[str, float]
    std_error: dict[str, float]
    left: float
    rig_left: float
    clipped: float

    def line(self) -> str:
        """One line of text."""
        within = ", ".join(f"{name} {1.96 * error:.2g}" for name, error in self.std_error.items())
        clipped = f"; {100 * self.clipped:.2g} % of the samples, its highest and lowest, left aside"
        return (
            f"{self.axis}: {self.text}, to {self.left:.1g} (95 % within {within}){clipped}; "
            f"the rig's controller leaves {self.rig_left:.2g} of the command"
        )


def find_laws(record: Record, rig: Rig) -> tuple[Law, ...]:
    """The law of every axis whose command was recorded; an axis that no law explains is left out.

    Least squares on increments of the command, which hold whatever an integrator started from. Samples at a limit of
    the command, and those that follow from them, are left aside: there the command is not what the law asked for.

    Parameters
    ----------
    record : Record
        With `i_ref`; an i_e that was logged is taken off.
    rig : Rig
        Of it, with a digital controller; says which signals the controller reads, and how late its command comes.
    """
    if record.i_ref is None or not rig.controller.is_digital:
        return ()
    i_e = np.zeros_like(record.y) if record.i_e is None or record.is_rebuilt else record.i_e
    rig_left, late, found = _increments(_unexplained(record, rig)), int(rig.controller.delay_samples), []
    for k, axis in enumerate(record.axes):
        command, free = record.i_ref[late:, k], ~at_limits(record.i_ref[late:, k])
        u = command - i_e[: len(command), k]
        fit = _Fit(u, _read(record, rig, k, len(u)), free, 1.0 / record.sample_rate)
        best = _best([fit.pid(), fit.filtered_pid(), *(fit.recursion(lags) for lags in range(1, MOST_LAGS + 1))])
        if best.left > ALIKE:
            continue
        left = rig_left[: len(u), k]
        missed = float(np.sqrt(np.mean(left[fit.rows(1)] ** 2)) / u.std())
        found.append(Law(axis, *best, rig_left=missed, clipped=float(1.0 - free.mean())))
    return tuple(found)


def _unexplained(record: Record, rig: Rig) -> FloatArray:
    """What the rig's controller leaves of the command beside a logged i_e."""
    signals = {name: getattr(record, name) for name in ("y", "i_ref", "i_c", "r")}
    i_e = None if record.is_rebuilt else record.i_e
    return unexplained(rig, record.sample_rate, **signals, i_e=i_e, where=str(record.path or record.name))


def _read(record: Record, rig: Rig, k: int, count: int) -> dict[str, FloatArray]:
    """What the controller of an axis reads, by the names of `Law.text`; the error first."""
    own, r = rig.controller, record.r
    y = record.y[:, k]
    signals = {"e": (r[:, k] if r is not None and own.reference else 0.0) - y}
    if r is not None and "r" in own.signals:
        signals["r"] = r[:, k]
    if record.i_c is not None and "i_c" in own.signals:
        signals["i_c"] = record.i_c[:, k]
    return {name: signal[:count] for name, signal in signals.items()}


def _increments(signal: FloatArray) -> FloatArray:
    return np.diff(signal, axis=0, prepend=signal[:1])


class _Found(NamedTuple):
    """A law that was fitted: what `Law` begins with."""

    text: str
    gains: dict[str, float]
    std_error: dict[str, float]
    left: float


def _best(laws: Sequence[_Found]) -> _Found:
    """The first that no later one betters by much."""
    best = laws[0]
    for law in laws[1:]:
        if best.left > EXACT and law.left < BETTER * best.left:
            best = law
    return best


@dataclass(frozen=True)
class _Fit:
    """Laws of one axis by least squares.

    Attributes
    ----------
    u : ndarray, shape (N,)
        Command.
    read : dict of str to ndarray
        What the controller reads, the error ``e`` first.
    free : ndarray of bool
        Samples in which u stands at no limit.
    step : float
        Of sampling [s].
    """

    u: FloatArray
    read: Mapping[str, FloatArray]
    free: NDArray[np.bool_]
    step: float

    def rows(self, lags: int) -> NDArray[np.intp]:
        """Samples whose command, and as many before, stand at no limit."""
        kept = self.free.copy()
        for lag in range(1, lags + 1):
            kept[lag:] &= self.free[:-lag]
        kept[: max(lags, 3)] = False
        return np.flatnonzero(kept)

    def pid(self) -> _Found:
        """Gains of e, of its trapezoidal sum and of its difference, and of other signals; small ones are dropped."""
        e, h = self.read["e"], self.step
        de = _increments(e)
        columns = {"e": de, "int e": h * (e - 0.5 * de), "de/dt": _increments(de) / h}
        columns |= {name: _increments(own) for name, own in self.read.items() if name != "e"}
        names = list(columns)
        while True:
            x, error, left = self._solved(np.column_stack([columns[name] for name in names]), 1)
            sure = np.abs(x) > TOLD * error
            if sure.all() or len(names) == 1:
                return _Found(_sum("u", names, x), _named(names, x), _named(names, error), left)
            names.pop(int(np.argmin(np.abs(x) / np.maximum(error, 1e-300))))

    def filtered_pid(self) -> _Found:
        """The same of e alone, its difference behind a lag."""
        e, h = self.read["e"], self.step
        table = np.column_stack([_back(_increments(self.u), 1), e, _back(e, 1), _back(e, 2)])
        x, error, left = self._solved(table, 2)
        if not 0.0 < x[0] < 1.0 or len(self.read) > 1:
            return _Found("", {}, {}, np.inf)

        def gains(x: FloatArray) -> FloatArray:
            a, now, before, earlier = x
            integral = (now + before + earlier) / (1.0 - a)
            jump = (now * a**2 + before * a + earlier) / (1.0 - a) ** 2
            lag = h * a / (1.0 - a)
            return np.array([now - 0.5 * integral - jump, integral / h, jump * (lag + h), lag])

        turned = np.array([gains(x + step) - gains(x - step) for step in np.diag(np.maximum(error, 1e-9))])
        errors = 0.5 * np.sqrt(np.sum(turned**2, axis=0))
        names, found = ["e", "int e", "de/dt"], gains(x)
        text = f"{_sum('u', names, found[:3])}, de/dt behind a lag of {1e3 * found[3]:.4g} ms"
        names.append("lag")
        return _Found(text, _named(names, found), _named(names, errors), left)

    def recursion(self, lags: int) -> _Found:
        """Commands before, and all that is read now and before."""
        past = {f"u[k-{j}]": _back(self.u, j) for j in range(1, lags + 1)}
        for name, own in self.read.items():
            past |= {f"{name}[k-{j}]" if j else f"{name}[k]": _back(own, j) for j in range(lags + 1)}
        table = np.column_stack([_increments(own) for own in past.values()])
        x, error, left = self._solved(table, lags + 1)
        size = np.abs(x) * np.linalg.norm(table, axis=0)
        told = size > ROUNDING * size.max()
        names = [name for name, own in zip(past, told, strict=True) if own]
        return _Found(_sum("u[k]", names, x[told]), _named(names, x[told]), _named(names, error[told]), left)

    def _solved(self, table: FloatArray, lags: int) -> tuple[FloatArray, FloatArray, float]:
        """Factors of columns that add up to the increments of u, their standard errors, and what is left of u."""
        rows = self.rows(lags)
        table, goal = table[rows], _increments(self.u)[rows]
        size = np.linalg.norm(table, axis=0)
        size[size == 0.0] = 1.0
        x = np.linalg.lstsq(table / size, goal, rcond=None)[0] / size
        left = goal - table @ x
        free = max(1, len(goal) - len(x))
        spread = np.linalg.pinv((table / size).T @ (table / size)).diagonal()
        error = np.sqrt(float(left @ left) / free * np.maximum(spread, 0.0)) / size
        return x, error, float(np.sqrt(left @ left / free) / max(self.u.std(), 1e-300))


def _back(signal: FloatArray, lag: int) -> FloatArray:
    """As it was so many samples before."""
    return np.concatenate([np.repeat(signal[:1], lag), signal[: len(signal) - lag]])


def _named(names: Iterable[str], values: FloatArray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _sum(left: str, names: Sequence[str], factors: FloatArray) -> str:
    signed = [(name, "-" if factor < 0.0 else "+", abs(factor)) for name, factor in zip(names, factors, strict=True)]
    terms = [f"{sign} {size:.4g} {name}" for name, sign, size in signed]
    return f"{left} = {' '.join(terms).removeprefix('+ ')}"
