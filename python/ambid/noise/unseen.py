"""What the misfit of a record without periods does not see, since it takes it for noise.

Without periods the noise is what no smooth response to the excitation leaves. What is missing and not linear, such as
friction, hardly bends a smooth response: it makes the noise louder, and J/dof stays 1. Three things contradict that.
Over all lines together, as the fit has them, no more may be left of a channel than its noise: J counts every line
alike, and what is missing on a few loud ones is lost in it. Noise has no shape: what does not come from the
excitation cannot follow a function of the motion that the excitation brings. And noise goes on where nothing moves:
a step moves a machine for a small part of a record, where what is missing stands out, and is lost over all of it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.errors import UnstableLoopError
from ambid.findings import Kind, Where
from ambid.model import Model
from ambid.noise.adequacy import Criterion
from ambid.noise.angles import undisturbed
from ambid.noise.chance import ADEQUATE
from ambid.noise.inlets import Sight
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from ambid.noise.shapes import Shapes

LONGEST = 131_072
"""Samples of a record without periods that are searched for a shape, from the first on: as many lines are judged of
these as of all, and the signals at the ports of four axes would take another third of a gigabyte a million samples."""
PORTS = {"force": "f", "current": "i_ref", "sensor": "y"}
"""Ports at which a shape may act, and the signal that it is added to."""
OVER_CEILING = Kind(
    "residual_above_noise",
    "warning",
    "{ratio:.2g} times the power of the noise is left, so that the fit stays below the attainable fit, at few "
    "frequencies beside all that the misfit counts alike: physics is missing, and parameters may be further off than "
    "their intervals state",
    "excite periodically, which separates noise from response",
)
PARTS = 40
"""Stretches of a record that are compared: short beside the time between steps, and enough to show how
much noise changes from one to the next. Where too few of them stand still, as between many steps, there are twice as
many, or four times, and so on; how noise changes is estimated from as many together as fill one of these."""
BAND = 0.8
"""Part of the motion, by power of its whitened rate, that the band which is looked at holds: above, all is noise."""
AT_REST = 0.01
"""Part of the motion, by power of its rate, that all stretches which stand still have together: 20 dB down."""
LEAST_STILL = 0.5
"""Part of the stretches that must stand still; below it the record is excited all along."""
LOUDER = Kind(
    "residual_higher_in_motion",
    "warning",
    "where the record moves, {moving_share:.0f|%} of its time, the residual below {below_hz:.3g} Hz has {ratio:.2g} "
    "times the power of where it stands still: noise does not depend on the motion, so that physics is missing, and "
    "parameters may be further off than their intervals state",
    "move it more often",
)


def power_left(part: RecordLines, here: Model) -> Criterion:
    """The channel of a record without periods that is left with most beyond its noise.

    The sum of the powers of all lines is compared with that of the noise there, which is about chi-squared with
    2 (sum P)^2 / sum P^2 degrees of freedom (Welch and Satterthwaite). Lines of tones are excluded: they are reported
    by themselves.

    Parameters
    ----------
    part : RecordLines
    here : Model
        At the operating point of the record.
    """
    power, usual = part.noise_power(), part.beside_tones
    left, power = np.abs(part.residual_lines(here)[usual]) ** 2, power[usual]
    ratio = left.sum(axis=0) / power.sum(axis=0)
    degrees = 2.0 * power.sum(axis=0) ** 2 / np.sum(power**2, axis=0)
    name, trials = part.record.name, len(ratio)
    channels = [
        Criterion("power", own, free, np.inf, trials, ADEQUATE, where=Where(record=name, channel=channel))
        for channel, own, free in zip(part.record.channels, ratio.tolist(), degrees.tolist(), strict=True)
    ]
    return max(channels, key=lambda own: own.statistic / own.limit)


def shape_left(part: RecordLines, model: Model, least: float = 0.0) -> Criterion | None:
    """The nonlinear shape that a model leaves of a record most surely; None where it cannot be determined.

    Parameters
    ----------
    part : RecordLines
    model : Model
        Fitted; its nonlinear effects are linearised at rest in the way from a port, or left out of it where rest is
        not stable: of noise every way is as good.
    least : float
        Score of a shape that formulas of the effects may leave.
    """
    part = _beginning(part, model)
    here = part.at(model)
    try:
        through = here if here.is_linear or here.is_stable else here.without_nonlinear()
        sight = Sight.of(here, part, PORTS, through)
    except UnstableLoopError:
        return None
    shapes = Shapes.of(sight, part)
    spread = 1.0 if part.noise_is_measured else float(np.mean(part.spectrum.spread))
    found = [(port, term) for port in PORTS for term in shapes.terms(port) if term.kind != "linear"]
    port, term = max(found, key=lambda own: own[1].score)
    degrees = len(term.coefficients)
    return Criterion(
        "shape",
        term.score / spread / degrees,
        degrees,
        trials=len(found),
        least=least / spread / degrees,
        where=Where(record=part.record.name),
        values={"port": port, "kind": term.kind, "shape": term.shape, "score": term.score / spread},
    )


def _beginning(part: RecordLines, model: Model) -> RecordLines:
    """The first `LONGEST` samples of a record without periods that has more."""
    if part.noise_is_measured or part.record.samples <= LONGEST:
        return part
    return RecordLines(model, Measured(part.record.rows(0, LONGEST)), part.tones, angles=part.angles)


def motion_left(part: RecordLines, here: Model) -> Criterion | None:
    """Hold what is left of a record without periods, where it moves, against what is left where it stands still.

    In the band where the machine moves, the mean power of the whitened residual over the stretches that move, over that
    of those that stand still, is compared with F. The degrees of freedom of a stretch are estimated from the scatter of
    those that stand still, 2 mean^2/variance: noise may change on the way.

    Parameters
    ----------
    part : RecordLines
    here : Model
        At the operating point of the record.

    Returns
    -------
    Criterion or None
        None where the record moves all along, or it is too short or too long to show it.
    """
    response, index = part.simulated(undisturbed(here)), part.index  # a hum never stands still
    left, whitening, samples = part.residual_lines(here), part.whitening, len(response)
    change = np.diff(response, axis=0, append=response[-1:])
    together, is_still = 1, _still(change, samples // PARTS)
    while is_still.sum() < LEAST_STILL * len(is_still):
        together *= 2
        is_still = _still(change, samples // (PARTS * together))
    if not len(is_still) or is_still.all():
        return None
    length = samples // (PARTS * together)
    power = np.cumsum(np.sum(np.abs(_whitened(whitening, rfft(change, axis=0)[index])) ** 2, axis=1))
    top = int(np.searchsorted(power, BAND * power[-1])) + 1
    if index[top - 1] - index[0] != top - 1:
        return None  # of so long a record not every line is judged
    lines = np.zeros((samples // 2 + 1, left.shape[1]), dtype=complex)
    lines[index[:top]] = _whitened(whitening, left)[:top]
    powers = _powers(irfft(lines, n=samples, axis=0), length).sum(axis=1)
    still, moved = powers[is_still], powers[~is_still]
    whole = still[: len(still) // together * together].reshape(-1, together).mean(axis=1)
    ratio, free = moved.mean() / still.mean(), 2.0 * still.mean() ** 2 / whole.var(ddof=1) / together
    below_hz, where = float(index[top - 1] * part.record.sample_rate / samples), Where(record=part.record.name)
    values = {"below_hz": below_hz, "moving_share": len(moved) / len(powers)}
    return Criterion("motion", float(ratio), free * len(moved), free * len(still), where=where, values=values)


def _still(change: FloatArray, length: int) -> NDArray[np.bool_]:
    """Which stretches of so many samples stand still; none where they are too short."""
    if length < 16:
        return np.zeros(0, dtype=bool)
    motion = np.sum(_powers(change, length) / np.maximum(np.einsum("kc,kc->c", change, change), 1e-300), axis=1)
    order = np.argsort(motion)
    is_still = np.zeros(len(motion), dtype=bool)
    is_still[order[np.cumsum(motion[order]) < AT_REST * motion.sum()]] = True
    return is_still


def _whitened(whitening: ComplexArray, lines: ComplexArray) -> ComplexArray:
    return np.asarray((whitening @ lines[..., None])[..., 0])


def _powers(signal: FloatArray, length: int) -> FloatArray:
    """Power of each channel of a signal in each stretch."""
    count = len(signal) // length
    cut = signal[: count * length].reshape(count, length, -1)
    return np.asarray(np.einsum("pkc,pkc->pc", cut, cut) / length)
