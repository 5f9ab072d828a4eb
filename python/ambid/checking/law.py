"""The law that a controller runs, found from its own recorded input and command, whatever the rig file says of it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambid.arrays import FloatArray
from ambid.record import Record
from ambid.record.checks import at_limits
from ambid.record.rebuild import commanded
from ambid.rig import Rig

MOST_LAGS = 4
"""Commands before that a recursion may hold on to: an integrator, and filters of third order."""
BETTER = 0.3
"""Part of what is left to which a law with more numbers must bring it to be preferred."""
EXACT = 1e-6
"""Part of the command below which what is left is rounding of what was logged, and the shortest law is taken."""
ROUNDING = 1e-6
"""Share in the largest term of a recursion below which a term is rounding, and not reported."""
SAME = 1e-6
"""Part of the rig's own command that its law may leave in the words of another, to be stated in these."""
ALIKE = 0.05
"""Part of the command up to which a law counts as found."""
SIGNIFICANT = 3.0
"""Standard errors that a gain must exceed to be reported."""
MOST_LATE = 2
"""Samples by which a command may come after what it answers to, beside those of the rig's delay."""


@dataclass(frozen=True)
class Law:
    """What one axis of a controller does, in its recorded samples.

    Attributes
    ----------
    axis : str
    text : str
        Such as ``u = 38 e + 188 int e + 1.92 de/dt, de/dt behind a lag of 0.5 ms``, e = r - y (or -y), which are the
        four gains of a digital PID in a rig file; else its recursion.
    gains : dict of str to float
        Factors of the terms of `text`, and the ``lag`` [s].
    std_error : dict of str to float
        Of these.
    left : float
        Rms of what it leaves from sample to sample, over that of the command without its mean.
    rig_left : float
        The same of the rig's controller.
    clipped : float
        Part of the samples in which the command stood at its highest or lowest; they are left aside.
    late : int
        Samples by which the recorded command comes after what it answers to.
    rig_late : int
        The same by the rig's delay, whole samples.
    factor : float
        By which the rig's controller as a whole meets the command best.
    factor_left : float
        What it leaves with this factor, as `left`.
    rig_gains : dict of str to float
        Factors of the terms of `text` in the rig's own law; empty where the text is a recursion.
    """

    axis: str
    text: str
    gains: dict[str, float]
    std_error: dict[str, float]
    left: float
    rig_left: float
    clipped: float
    late: int
    rig_late: int
    factor: float
    factor_left: float
    rig_gains: dict[str, float]

    def line(self) -> str:
        """One line of text."""
        within = ", ".join(f"{name} {1.96 * error:.2g}" for name, error in self.std_error.items())
        clipped = f"; {100 * self.clipped:.2g} % of the samples, its highest and lowest, left aside"
        return (
            f"{self.axis}: {self.text}, to {self.left:.1g} (95 % within {within}){clipped}; "
            f"the rig's controller leaves {self.rig_left:.2g} of the command{self._delay()}"
        )

    def _delay(self) -> str:
        """By how much the command comes late, where it or the rig's does."""
        if self.late == self.rig_late == 0:
            return ""
        shown = f"; it comes {_samples(self.late)} after what it answers to" if self.late else "; it shows no delay"
        if self.late == self.rig_late:
            return f"{shown}, as the rig says"
        before = ", and was recorded before it, or there is none" if self.late == 0 else ""
        return f"{shown}: the rig has {_samples(self.rig_late)}{before}"


def find_laws(record: Record, rig: Rig) -> tuple[Law, ...]:
    """The law of every axis whose command was recorded; an axis that no law explains is left out.

    Least squares on increments of the command, which hold whatever an integrator started from. Samples at a limit of
    the command, and those that follow from them, are left aside: there the command is not what the law asked for. Of
    several delays of the command the one counts under which a law leaves least; the rig's, where others do as well.

    Parameters
    ----------
    record : Record
        With `i_ref`; an i_e that was logged is taken off.
    rig : Rig
        Of it, with a digital controller; says which signals the controller reads.
    """
    own, rate = rig.controller, record.sample_rate
    if record.i_ref is None or not own.is_digital or abs(own.rate(rate) - rate) > 1e-6 * rate:
        return ()
    i_e = np.zeros_like(record.y) if record.i_e is None or record.is_rebuilt else record.i_e
    of_rig = commanded(rig, rate, y=record.y, i_c=record.i_c, r=record.r, where=str(record.path or record.name))
    settled, whole = _settled(rig, rate), int(own.delay_samples)
    delays = sorted({*range(MOST_LATE + 1), whole}, key=lambda late: abs(late - whole))
    found = []
    for k, axis in enumerate(record.axes):
        fits = []
        for late in delays:
            command = record.i_ref[late:, k]
            u = command - i_e[: len(command), k]
            fits.append(_Fit(u, _read(record, rig, k, len(u)), ~at_limits(command), 1.0 / rate, late))
        kinds = [[fit.law(kind) for fit in fits] for kind in range(2 + MOST_LAGS)]
        best = _best([min(own, key=lambda law: max(law.left, EXACT)) for own in kinds])
        if best.left > ALIKE:
            continue
        fit = next(fit for fit in fits if fit.late == best.late)
        rig_u = of_rig[: len(fit.u), k]
        rig_left, factor, factor_left = fit.against(rig_u, settled)
        rig_gains: dict[str, float] = {}
        if best.kind < 2:
            read = replace(fit, u=rig_u, free=fit.free & (np.arange(len(rig_u)) >= settled)).law(best.kind)
            rig_gains = read.gains if read.left < SAME else {}
        found.append(
            Law(
                axis,
                best.text,
                best.gains,
                best.std_error,
                best.left,
                rig_left=rig_left,
                clipped=float(1.0 - fit.free.mean()),
                late=best.late,
                rig_late=whole,
                factor=factor,
                factor_left=factor_left,
                rig_gains=rig_gains,
            )
        )
    return tuple(found)


def _samples(count: int) -> str:
    return f"{count} sample{'' if count == 1 else 's'}"


def _settled(rig: Rig, rate: float) -> int:
    """Samples after which a controller's output no longer shows what it held at first, but for its integrators."""
    poles = np.abs(np.linalg.eigvals(rig.controller.state_space(len(rig.axes), rate)[0]))
    slowest = poles[poles < 1.0 - 1e-6].max(initial=1e-3)
    return int(np.ceil(np.log(1e-9) / np.log(max(slowest, 1e-3))))


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


_Terms = tuple[str, dict[str, float], dict[str, float], float]
"""Text, gains and their standard errors of a law that was fitted, and what it leaves."""


class _Found(NamedTuple):
    """A law that was fitted: what `Law` begins with, how it was sought (see `_Fit.law`), and its delay."""

    text: str
    gains: dict[str, float]
    std_error: dict[str, float]
    left: float
    kind: int
    late: int


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
    late : int
        Samples by which u was recorded after what is read.
    """

    u: FloatArray
    read: Mapping[str, FloatArray]
    free: NDArray[np.bool_]
    step: float
    late: int

    def law(self, kind: int) -> _Found:
        """Sought as a PID (0), as one whose difference is filtered (1), or as a recursion (2 on)."""
        text, gains, std_error, left = (
            (self._pid, self._filtered_pid)[kind]() if kind < 2 else self._recursion(kind - 1)
        )
        return _Found(text, gains, std_error, left, kind, self.late)

    def against(self, other: FloatArray, begin: int) -> tuple[float, float, float]:
        """What another command leaves of u from a sample on, the factor on it that leaves least, and what that does."""
        rows = self.rows(1)
        rows = rows[rows >= begin]
        own, other = (_increments(signal)[rows] for signal in (self.u, other))
        own, other = own - own.mean(), other - other.mean()  # what two integrators held is a slope
        factor = float(own @ other / max(float(other @ other), 1e-300))
        left = [float(np.sqrt(np.mean((own - own_factor * other) ** 2)) / self.size) for own_factor in (1.0, factor)]
        return left[0], factor, left[1]

    @property
    def size(self) -> float:
        """Rms of u without its mean."""
        return max(float(self.u.std()), 1e-300)

    def rows(self, lags: int) -> NDArray[np.intp]:
        """Samples whose command, and as many before, stand at no limit."""
        kept = self.free.copy()
        for lag in range(1, lags + 1):
            kept[lag:] &= self.free[:-lag]
        kept[: max(lags, 3)] = False
        return np.flatnonzero(kept)

    def _pid(self) -> _Terms:
        """Gains of e, of its trapezoidal sum and of its difference, and of other signals; small ones are dropped.

        A difference over one sample is, by Tustin's rule, a derivative behind a lag of half a sample.
        """
        e, h = self.read["e"], self.step
        de = _increments(e)
        columns = {"e": de, "int e": h * (e - 0.5 * de), "de/dt": _increments(de) / h}
        columns |= {name: _increments(own) for name, own in self.read.items() if name != "e"}
        names = list(columns)
        while True:
            x, error, left = self._solved(np.column_stack([columns[name] for name in names]), 1)
            sure = np.abs(x) > SIGNIFICANT * error
            if sure.all() or len(names) == 1:
                gains, lag = _named(names, x), {"lag": 0.5 * h} if "de/dt" in names else {}
                return _pid_text(gains | lag), gains | lag, _named(names, error), left
            names.pop(int(np.argmin(np.abs(x) / np.maximum(error, 1e-300))))

    def _filtered_pid(self) -> _Terms:
        """The same of e alone, its derivative behind a lag, both by Tustin's rule as `rig.PidController` has them."""
        e, h = self.read["e"], self.step
        table = np.column_stack([_back(_increments(self.u), 1), e, _back(e, 1), _back(e, 2)])
        x, error, left = self._solved(table, 2)
        if not -1.0 < x[0] < 1.0 or len(self.read) > 1:
            return "", {}, {}, np.inf

        def gains(x: FloatArray) -> FloatArray:
            a, now, before, earlier = x
            integral = (now + before + earlier) / (1.0 - a)
            jump = (now * a**2 + before * a + earlier) / (1.0 - a) ** 2
            lag = 0.5 * h * (1.0 + a) / (1.0 - a)
            return np.array([now - 0.5 * integral - jump, integral / h, jump * (lag + 0.5 * h), lag])

        turned = np.array([gains(x + step) - gains(x - step) for step in np.diag(np.maximum(error, 1e-9))])
        errors = 0.5 * np.sqrt(np.sum(turned**2, axis=0))
        found = _named(("e", "int e", "de/dt", "lag"), gains(x))
        return _pid_text(found), found, _named(found, errors), left

    def _recursion(self, lags: int) -> _Terms:
        """Commands before, and all that is read now and before."""
        past = {f"u[k-{j}]": _back(self.u, j) for j in range(1, lags + 1)}
        for name, own in self.read.items():
            past |= {f"{name}[k-{j}]" if j else f"{name}[k]": _back(own, j) for j in range(lags + 1)}
        table = np.column_stack([_increments(own) for own in past.values()])
        x, error, left = self._solved(table, lags + 1)
        size = np.abs(x) * np.linalg.norm(table, axis=0)
        significant = size > ROUNDING * size.max()
        names = [name for name, own in zip(past, significant, strict=True) if own]
        gains = _named(names, x[significant])
        return _sum("u[k]", gains), gains, _named(names, error[significant]), left

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
        return x, error, float(np.sqrt(left @ left / free) / self.size)


def _back(signal: FloatArray, lag: int) -> FloatArray:
    """As it was so many samples before."""
    return np.concatenate([np.repeat(signal[:1], lag), signal[: len(signal) - lag]])


def _named(names: Iterable[str], values: FloatArray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _pid_text(gains: Mapping[str, float]) -> str:
    """Such as ``u = 38 e + 188 int e + 1.92 de/dt, de/dt behind a lag of 0.5 ms``, as a rig file has it."""
    text = _sum("u", {name: gain for name, gain in gains.items() if name != "lag"})
    return f"{text}, de/dt behind a lag of {1e3 * gains['lag']:.4g} ms" if "lag" in gains else text


def _sum(left: str, factors: Mapping[str, float]) -> str:
    terms = [f"{'-' if factor < 0.0 else '+'} {abs(factor):.4g} {name}" for name, factor in factors.items()]
    return f"{left} = {' '.join(terms).removeprefix('+ ')}"
