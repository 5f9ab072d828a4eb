"""The signal that a port needs over one period, and the shapes that it may have over the signals of the loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.ndimage import uniform_filter1d

from ambid.arrays import ComplexArray, FloatArray, stacked
from ambid.errors import ModelError
from ambid.noise.chance import log_chance
from ambid.noise.inlets import Left, Sight
from ambid.noise.lines import RecordLines, as_lines
from ambid.noise.window import Window
from ambid.rig import Rig

WATCHED = ("s", "v", "i_f", "i_ref", "y")


class Shape(NamedTuple):
    """Its kind, the unit of its coefficient, itself over the signals of the loop, and whether it is of the other axis.

    The two axes of a bearing may answer each other with either sign.
    """

    kind: str
    unit: str
    of: Callable[[dict[str, FloatArray]], FloatArray]
    is_across: bool = False


def _sign(x: FloatArray) -> FloatArray:
    return np.tanh(x / (0.05 * x.std(axis=0) + 1e-300))


TERMS: dict[str, dict[str, Shape]] = {
    "force": {
        "ds/dt": Shape("linear", "N s/m", lambda x: x["v"]),
        "s of the other axis": Shape("linear", "N/m", lambda x: x["s_other"], is_across=True),
        "ds/dt of the other axis": Shape("linear", "N s/m", lambda x: x["v_other"], is_across=True),
        "s^3": Shape("odd", "N/m^3", lambda x: x["s"] ** 3),
        "s |s|": Shape("odd", "N/m^2", lambda x: x["s"] * np.abs(x["s"])),
        "i^3": Shape("odd", "N/A^3", lambda x: x["i_f"] ** 3),
        "i^2 s": Shape("odd", "N/(A^2 m)", lambda x: x["i_f"] ** 2 * x["s"]),
        "i s^2": Shape("odd", "N/(A m^2)", lambda x: x["i_f"] * x["s"] ** 2),
        "ds/dt |ds/dt|": Shape("odd", "N s^2/m^2", lambda x: x["v"] * np.abs(x["v"])),
        "sign ds/dt": Shape("odd", "N", lambda x: _sign(x["v"])),
        "s^2": Shape("even", "N/m^2", lambda x: x["s"] ** 2),
        "|s|": Shape("even", "N/m", lambda x: np.abs(x["s"])),
        "i^2": Shape("even", "N/A^2", lambda x: x["i_f"] ** 2),
        "|i|": Shape("even", "N/A", lambda x: np.abs(x["i_f"])),
        "i s": Shape("even", "N/(A m)", lambda x: x["i_f"] * x["s"]),
    },
    "current": {
        "i^3": Shape("odd", "1/A^2", lambda x: x["i_ref"] ** 3),
        "sign i": Shape("odd", "A", lambda x: _sign(x["i_ref"])),
        "i^2": Shape("even", "1/A", lambda x: x["i_ref"] ** 2),
        "|i|": Shape("even", "", lambda x: np.abs(x["i_ref"])),
    },
    "sensor": {
        "y^3": Shape("odd", "1/m^2", lambda x: x["y"] ** 3),
        "y^2": Shape("even", "1/m", lambda x: x["y"] ** 2),
        "|y|": Shape("even", "", lambda x: np.abs(x["y"])),
    },
    "reading": {},
}


@dataclass(frozen=True)
class Term:
    """A shape that a needed signal may have, with a coefficient for each axis.

    Attributes
    ----------
    shape, kind : str
        Such as ``s^3``; linear, odd or even.
    coefficients : ndarray, shape (axes,)
        In the unit of the port over that of the shape.
    score : float
        Fall of J that it would bring beside the parameters of the model.
    share : float
        Part of the excess misfit that it explains, 0 to 1.
    chance : float
        Logarithm of the p-value of the score.
    """

    shape: str
    kind: str
    coefficients: FloatArray
    score: float
    share: float
    chance: float


@dataclass(frozen=True)
class Shapes:
    """Signals of the loop over one period, and how well shapes over them explain a record.

    Attributes
    ----------
    sight : Sight
    window : Window
    against : dict of str to ndarray, shape (N, axes)
        Signals of the model over one period, mean over the periods of the record.
    residual, known : ndarray, shape (numbers,) and (numbers, parameters)
        Excited lines of the whitened residual without what the parameters of the model can absorb, and an orthonormal
        basis of that.
    cost : float
        Sum of squares of the residual.
    """

    sight: Sight
    window: Window
    against: dict[str, FloatArray]
    residual: FloatArray
    known: FloatArray
    cost: float

    @classmethod
    def of(cls, sight: Sight, part: RecordLines) -> Shapes:
        """Simulate the signals."""
        model, record, window = sight.model, part.record, part.window
        axes, p, lines = len(record.axes), len(record.channels), len(window.excited)
        outputs = model.watching(WATCHED).simulate(model.theta, model.excitation(record))
        settled = window.settled
        periods = settled.cut(outputs).reshape(settled.periods, settled.period, -1).mean(axis=0)
        watched = periods[:, -len(WATCHED) * axes :]
        against = {name: watched[:, k * axes : (k + 1) * axes] for k, name in enumerate(WATCHED)}
        other = _other_axis(model.rig)
        against |= {f"{name}_other": against[name][:, other] for name in ("s", "v")}
        residual, slopes = sight.numbers
        size = np.linalg.norm(slopes, axis=0)
        basis, _ = np.linalg.qr(slopes[:, size > 0.0] / size[size > 0.0])
        white = as_lines(residual - basis @ (basis.T @ residual), p)[:lines]
        known = stacked(as_lines(basis, p)[:lines].reshape(lines * p, basis.shape[1]))
        cost = float(np.sum(np.abs(white) ** 2))
        return cls(sight, window, against, stacked(white.reshape(-1, 1))[:, 0], known, cost)

    def needed(self, left: Left) -> FloatArray:
        """What a port needs over one period, mean over the periods, shape (N, axes)."""
        axes, window = left.needed.shape[1], self.window
        explained = self.sight.residual - left.residual
        full = np.zeros((window.period // 2 + 1, axes), dtype=complex)
        seen = _seen_share(explained, 2 * axes)[:, None]
        full[window.in_period] = left.needed * seen * (np.sqrt(window.samples) / window.periods)
        return np.asarray(irfft(full, n=window.period, axis=0))

    def terms(self, port: str) -> tuple[Term, ...]:
        """The simple shapes of a port, the likeliest first."""
        found, way = [], self.sight.way(port)
        axes, excess = way.shape[-1], max(self.cost - self.residual.size, 1.0)
        for shape, simple in TERMS[port].items():
            signal = simple.of(self.against)
            size = signal.std(axis=0) + 1e-300
            spectrum = self._spectrum(signal / size)
            columns = self._beside_known((way * spectrum[:, None, :]).reshape(-1, axes))
            q, r = np.linalg.qr(columns)
            called_for = q.T @ self.residual
            score = float(called_for @ called_for)
            coefficients = np.linalg.lstsq(r, called_for, rcond=1e-9)[0] / size
            chance = log_chance(score, axes)
            found.append(Term(shape, simple.kind, coefficients, score, min(score / excess, 1.0), chance))
        return tuple(sorted(found, key=lambda term: term.chance))

    def weights(self, port: str, signals: FloatArray, rows: FloatArray, wanted: FloatArray) -> tuple[FloatArray, float]:
        """As `Port.weights`."""
        way = self.sight.way(port)
        columns = self._beside_known((way @ self._spectrum(signals)).reshape(-1, signals.shape[2]))
        both = np.vstack([columns, rows]), np.concatenate([self.residual, wanted])
        # combinations of signals that the records see less of have no weight
        found = np.asarray(np.linalg.lstsq(*both, rcond=1e-9)[0], dtype=np.float64)
        left = self.residual - columns @ found
        return found, (self.cost - float(left @ left)) / max(self.cost - self.residual.size, 1.0)

    def _spectrum(self, signal: FloatArray) -> ComplexArray:
        """Excited lines of a signal over one period, in the unit of the record's."""
        lines = rfft(signal - signal.mean(axis=0), axis=0)[self.window.in_period]
        return np.asarray(lines * (self.window.periods / np.sqrt(self.window.samples)))

    def _beside_known(self, lines: ComplexArray) -> FloatArray:
        columns = stacked(lines)
        return np.asarray(columns - self.known @ (self.known.T @ columns))


@dataclass(frozen=True)
class NoShapes:
    """The same of a frequency response, which has no signals.

    Attributes
    ----------
    axes : int
    against : dict
        Empty.
    """

    axes: int
    against: dict[str, FloatArray]

    def needed(self, left: Left) -> FloatArray:
        """No sample."""
        return np.zeros((0, self.axes))

    def terms(self, port: str) -> tuple[Term, ...]:
        """None."""
        return ()

    def weights(self, port: str, *_: FloatArray) -> tuple[FloatArray, float]:
        """Refuse."""
        raise ModelError(
            f"a frequency response has no signal at the {port} port; measure its shape from a record in time"
        )


def _other_axis(rig: Rig) -> NDArray[np.intp]:
    """Index of the other axis of the same bearing; its own where there is none."""
    found: list[int] = []
    for bearing in rig.bearings:
        first, count = len(found), len(bearing.axes)
        found += [first + (k + 1) % count for k in range(count)]
    return np.array(found)


def _seen_share(explained: ComplexArray, degrees: int) -> FloatArray:
    """Part of each line's power that is no noise, from 15 neighbours to each side, 0 to 1."""
    power = uniform_filter1d(np.sum(np.abs(explained) ** 2, axis=1), 31, mode="nearest")
    return np.maximum(0.0, 1.0 - degrees / np.maximum(power, degrees))
