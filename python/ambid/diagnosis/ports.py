"""Where in the loop does something act that the model lacks: the signal that a port would need, and its shape.

The residual on the excited lines is mapped back through the closed loop to a force at each magnet, a current at each
amplifier, or a displacement at each sensor. The port type that needs nothing beyond noise in the other directions is
where the missing physics acts; its needed signal, averaged over the periods, against s, ds/dt and i is its shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft
from scipy.ndimage import uniform_filter1d

from ambid.arrays import ComplexArray, FloatArray
from ambid.diagnosis.chance import log_chance
from ambid.errors import ModelError
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.lines import as_lines
from ambid.noise.response_lines import ResponseLines
from ambid.noise.window import Window
from ambid.rig import Rig

__all__ = ["Port", "Term", "needed_at_ports"]

PORTS = {
    "force": ("f", "N", "force at the magnets, whatever its cause: magnet, seal, rotor"),
    "current": ("i_ref", "A", "current at the amplifiers, command included"),
    "sensor": ("y", "m", "displacement at the sensors"),
    "reading": ("i_c", "A", "reading of the current alone"),
}
VOLTAGE = {"current": ("i_ref", "V", "voltage of the coils, command included")}
"""The same port where the command is a voltage."""
UNSEEN = 1e-9
"""Of the largest singular value: combinations of signals that the records see less of have no weight."""
WATCHED = ("s", "v", "i_f", "i_ref", "y")
Shape = Callable[[dict[str, FloatArray]], FloatArray]


def _sign(x: FloatArray) -> FloatArray:
    return np.tanh(x / (0.05 * x.std(axis=0) + 1e-300))


TERMS: dict[str, dict[str, tuple[str, Shape]]] = {
    "force": {
        "ds/dt": ("linear", lambda x: x["v"]),
        "s of the other axis": ("linear", lambda x: x["s_other"]),
        "ds/dt of the other axis": ("linear", lambda x: x["v_other"]),
        "s^3": ("odd", lambda x: x["s"] ** 3),
        "s |s|": ("odd", lambda x: x["s"] * np.abs(x["s"])),
        "i^3": ("odd", lambda x: x["i_f"] ** 3),
        "i^2 s": ("odd", lambda x: x["i_f"] ** 2 * x["s"]),
        "i s^2": ("odd", lambda x: x["i_f"] * x["s"] ** 2),
        "ds/dt |ds/dt|": ("odd", lambda x: x["v"] * np.abs(x["v"])),
        "sign ds/dt": ("odd", lambda x: _sign(x["v"])),
        "s^2": ("even", lambda x: x["s"] ** 2),
        "|s|": ("even", lambda x: np.abs(x["s"])),
        "i^2": ("even", lambda x: x["i_f"] ** 2),
        "|i|": ("even", lambda x: np.abs(x["i_f"])),
        "i s": ("even", lambda x: x["i_f"] * x["s"]),
    },
    "current": {
        "i^3": ("odd", lambda x: x["i_ref"] ** 3),
        "sign i": ("odd", lambda x: _sign(x["i_ref"])),
        "i^2": ("even", lambda x: x["i_ref"] ** 2),
        "|i|": ("even", lambda x: np.abs(x["i_ref"])),
    },
    "sensor": {
        "y^3": ("odd", lambda x: x["y"] ** 3),
        "y^2": ("even", lambda x: x["y"] ** 2),
        "|y|": ("even", lambda x: np.abs(x["y"])),
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
class Port:
    """What one type of port would need so that the model meets the measurement.

    Attributes
    ----------
    name, unit, meaning : str
        force, current, sensor or reading.
    misfit : float
        J/dof that is left when this port is given whatever it needs: 1 where the missing physics acts; NaN where the
        port could explain anything, since there are no more channels than axes.
    free : int
        Degrees of freedom of that misfit.
    needed : ndarray, shape (N, axes)
        The needed signal over one period, in `unit`, mean over the periods of the record; of a frequency response,
        which has no signal, N is 0.
    against : dict of str to ndarray, shape (N, axes)
        ``s`` [m], ``v`` [m/s], ``i_f`` [A], ``i_ref`` [A] and ``y`` [m] of the model over the same period.
    terms : tuple of Term
        Shapes that the needed signal may have, the best first.
    weights : callable
        Least squares in units of noise, beside the parameters of the model: given signals over one period, shape
        (N, axes, k), the k weights at which they act at this port, and the part of the excess misfit that they explain.
        What is known of the weights beforehand are rows of k columns and what they should give, in standard deviations.
    share : float
        Part of the excess misfit that a signal at this port explains, whatever its shape.
    """

    name: str
    unit: str
    meaning: str
    misfit: float
    free: int
    needed: FloatArray
    against: dict[str, FloatArray]
    terms: tuple[Term, ...]
    weights: Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, float]] = field(repr=False, compare=False)
    share: float = 1.0


class _Inlets(Effect):
    """Further inputs at every port; no physics."""

    name = "inlets"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """None."""
        return []

    def attach(self, plant: Plant) -> None:
        """An input of each axis at each port."""
        for name, (signal, _, _) in PORTS.items():
            for axis in plant.axes:
                plant.inject(f"{signal}.{axis}", plant.input(f"{name}.{axis}"))


def needed_at_ports(comparison: Comparison, index: int = 0) -> tuple[Port, ...]:
    """Every port type with the signal that it would need, best first.

    Parameters
    ----------
    comparison : Comparison
        Of a fitted model; its nonlinear effects are linearised at rest in the way back to the port.
    index : int
        Of the record that is looked at.
    """
    model, part = comparison.model, comparison.noise.parts[index]
    if isinstance(part, ResponseLines):
        return _of_response(model, part)
    record, window = part.record, part.window
    axes, p, lines = len(record.axes), len(record.channels), len(window.excited)
    whitening = part.spectrum.whitening[:lines]
    here = model.at(record)
    loop = here.watching(WATCHED, [_Inlets()])
    inputs = here.excitation(record)
    quiet = np.hstack([inputs, np.zeros((len(inputs), len(loop.inputs) - inputs.shape[1]))])
    outputs = loop.simulate(model.theta, quiet)
    settled = window.settled
    periods = settled.cut(outputs).reshape(settled.periods, settled.period, -1).mean(axis=0)
    against = {name: periods[:, (2 + k) * axes : (3 + k) * axes] for k, name in enumerate(WATCHED)}
    other = _other_axis(model.rig)
    against |= {f"{name}_other": against[name][:, other] for name in ("s", "v")}

    residual, known, *_ = part.white(here, list(range(len(model.names))))
    size = np.linalg.norm(known, axis=0)
    basis, _ = np.linalg.qr(known[:, size > 0.0] / size[size > 0.0])
    white = as_lines(residual - basis @ (basis.T @ residual), p)[:lines]
    cost = float(np.sum(np.abs(white) ** 2))
    responses = loop.transfer(model.theta, window.points(window.excited))

    found = []
    for name, (_, unit, meaning) in _seen(record.channels, model.rig).items():
        columns = [k for k, inlet in enumerate(loop.inputs) if inlet.startswith(f"{name}.")]
        way = whitening @ responses[:, :p, columns]
        spectrum = _least_squares(way, white)
        left = white - (way @ spectrum[..., None])[..., 0]
        free = 2 * (p - np.linalg.matrix_rank(way[lines // 2], tol=1e-9 * np.abs(way).max())) * lines
        misfit = float(np.sum(np.abs(left) ** 2)) / free if free > 0 else np.nan
        factor = np.sqrt(window.samples) / window.periods
        full = np.zeros((window.period // 2 + 1, axes), dtype=complex)
        full[window.in_period] = spectrum * _seen_share(white - left, 2 * axes)[:, None] * factor
        needed = irfft(full, n=window.period, axis=0)
        terms = _terms(name, against, way, white, cost, basis, window)
        weights = partial(_weights, way=way, white=white, cost=cost, basis=basis, window=window)
        share = _share(cost, white.size * 2, float(np.sum(np.abs(left) ** 2)), free)
        found.append(Port(name, unit, meaning, misfit, free, needed, against, terms, weights, share))
    return tuple(sorted(found, key=_by_misfit_then_shape))


def _seen(channels: Sequence[str], rig: Rig) -> dict[str, tuple[str, str, str]]:
    """The ports of which what was recorded tells something: no reading of a current that was not recorded."""
    ports = PORTS if rig.amplifier.resistance is None else PORTS | VOLTAGE
    return {
        name: own
        for name, own in ports.items()
        if name != "reading" or any(channel.startswith("i_c.") for channel in channels)
    }


def _of_response(model: Model, part: ResponseLines) -> tuple[Port, ...]:
    """The same of a frequency response: what each port would need is a response to each excitation, and no signal."""
    here, (count, outputs, inputs) = model.at(part.record), part.record.response.shape
    if not here.is_linear:
        here = here.without_nonlinear()
    loop = here.watching((), [_Inlets()])
    rows = [loop.outputs.index(name) for name in part.record.outputs]
    residual, known, *_ = part.white(here, list(range(len(here.names))))
    size = np.linalg.norm(known, axis=0)
    basis, _ = np.linalg.qr(known[:, size > 0.0] / size[size > 0.0])
    white = as_lines(residual - basis @ (basis.T @ residual), outputs * inputs)
    responses = loop.transfer(here.theta, part.points(here))[:, rows]
    found, nothing = [], np.zeros((0, len(here.rig.axes)))
    for name, (_, unit, meaning) in _seen(part.record.outputs, model.rig).items():
        columns = [k for k, inlet in enumerate(loop.inputs) if inlet.startswith(f"{name}.")]
        # each excitation calls for a signal of its own
        ways = np.einsum("koc,ij->koicj", responses[:, :, columns], np.eye(inputs))
        way = part.whitening @ ways.reshape(count, outputs * inputs, -1)
        left = white - (way @ _least_squares(way, white)[..., None])[..., 0]
        scale = np.abs(way).max(axis=(1, 2), keepdims=True) + 1e-300
        free = part.judged - 2 * int(np.linalg.matrix_rank(way / scale, tol=1e-9).sum())
        misfit = float(np.sum(np.abs(left) ** 2)) / free if free > 0 else np.nan
        share = _share(float(np.sum(np.abs(white) ** 2)), part.judged, float(np.sum(np.abs(left) ** 2)), free)
        found.append(Port(name, unit, meaning, misfit, free, nothing, {}, (), _no_signal, share))
    return tuple(sorted(found, key=_by_misfit_then_shape))


def _share(cost: float, numbers: int, left: float, free: int) -> float:
    """Part of what is more than noise in a cost of so many numbers that is gone with a signal, which has its own."""
    excess = cost - numbers
    return float(np.clip(1.0 - (left - free) / excess, 0.0, 1.0)) if excess > 0.0 else 0.0


def _no_signal(*_: FloatArray) -> tuple[FloatArray, float]:
    raise ModelError("a frequency response tells no signal at a port; measure its shape from a record in time")


def _other_axis(rig: Rig) -> NDArray[np.intp]:
    """Index of the other axis of the same bearing; its own where there is none."""
    found: list[int] = []
    for bearing in rig.bearings:
        first, count = len(found), len(bearing.axes)
        found += [first + (k + 1) % count for k in range(count)]
    return np.array(found)


def _by_misfit_then_shape(port: Port) -> tuple[float, float]:
    """Ports that leave about as little are told apart by how much of it a simple shape explains."""
    left = 1.0 if np.isnan(port.misfit) else max(port.misfit, 1.0)
    return round(np.log(left) / 0.2), -port.terms[0].score if port.terms else 0.0


def _seen_share(explained: ComplexArray, degrees: int, neighbours: int = 15) -> FloatArray:
    """Part of each line's power that is no noise, from its neighbourhood, 0 to 1."""
    power = uniform_filter1d(np.sum(np.abs(explained) ** 2, axis=1), 2 * neighbours + 1, mode="nearest")
    return np.maximum(0.0, 1.0 - degrees / np.maximum(power, degrees))


def _terms(
    port: str,
    signals: dict[str, FloatArray],
    way: ComplexArray,
    white: ComplexArray,
    cost: float,
    basis: FloatArray,
    window: Window,
) -> tuple[Term, ...]:
    found = []
    lines, p, axes = way.shape
    by_line = np.stack([as_lines(column, p)[:lines] for column in basis.T], axis=-1)
    known = _stacked(by_line.reshape(-1, basis.shape[1]))
    residual = _stacked(white.reshape(-1, 1))[:, 0]
    for shape, (kind, function) in TERMS[port].items():
        signal = function(signals)
        size = signal.std(axis=0) + 1e-300
        spectrum = rfft((signal - signal.mean(axis=0)) / size, axis=0)[window.in_period]
        spectrum *= window.periods / np.sqrt(window.samples)
        columns = _stacked((way * spectrum[:, None, :]).reshape(-1, axes))
        columns = columns - known @ (known.T @ columns)
        q, r = np.linalg.qr(columns)
        called_for = q.T @ residual
        score = float(called_for @ called_for)
        coefficients = np.linalg.lstsq(r, called_for, rcond=1e-9)[0] / size
        excess = max(cost - residual.size, 1.0)
        found.append(Term(shape, kind, coefficients, score, min(score / excess, 1.0), log_chance(score, axes)))
    return tuple(sorted(found, key=lambda term: term.chance))


def _weights(
    signals: FloatArray,
    rows: FloatArray,
    wanted: FloatArray,
    *,
    way: ComplexArray,
    white: ComplexArray,
    cost: float,
    basis: FloatArray,
    window: Window,
) -> tuple[FloatArray, float]:
    lines, p, _ = way.shape
    known = _stacked(np.stack([as_lines(column, p)[:lines] for column in basis.T], axis=-1).reshape(-1, basis.shape[1]))
    spectrum = rfft(signals - signals.mean(axis=0), axis=0)[window.in_period] * window.periods / np.sqrt(window.samples)
    columns = _stacked((way @ spectrum).reshape(-1, signals.shape[2]))
    columns -= known @ (known.T @ columns)
    residual = _stacked(white.reshape(-1, 1))[:, 0]
    both = np.vstack([columns, rows]), np.concatenate([residual, wanted])
    found = np.asarray(np.linalg.lstsq(*both, rcond=UNSEEN)[0], dtype=np.float64)
    left = residual - columns @ found
    return found, (cost - float(left @ left)) / max(cost - residual.size, 1.0)


def _least_squares(way: ComplexArray, white: ComplexArray) -> ComplexArray:
    """Per line, the input of least norm that explains most of the whitened residual."""
    return (np.linalg.pinv(way, rcond=1e-9) @ white[..., None])[..., 0]


def _stacked(lines: ComplexArray) -> FloatArray:
    return np.concatenate([lines.real, lines.imag])
