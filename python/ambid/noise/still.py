"""Is what a model leaves louder where the machine moves than where it stands still, as before and after a step?

Noise goes on where nothing moves; what a model misses does not. A step moves a machine for a small part of a record,
and over the whole record what is missing then is lost in the noise, however far it stands out of it there and then.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft

from ambid.arrays import ComplexArray, FloatArray
from ambid.findings import Kind, Where
from ambid.model import Model
from ambid.noise.adequacy import Criterion
from ambid.noise.angles import undisturbed
from ambid.noise.lines import RecordLines

PARTS = 40
"""Stretches of a record that are compared: short beside the time between steps, and enough to show how
much noise changes from one to the next. Where too few of them stand still, as between many steps, there are twice as
many, or four times, and so on; how noise changes is estimated from as many together as fill one of these."""
LEAST_SAMPLES = 16
"""Samples of a stretch that is judged."""
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
    if length < LEAST_SAMPLES:
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
