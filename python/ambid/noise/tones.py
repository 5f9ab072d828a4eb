"""Lines that stand out between the excited ones: what has a frequency of its own, such as unbalance or mains hum.

The lines between the excited ones hold noise, and what a tone spills there. Under a Hann window a tone stands in a few
lines of its spectrum, far above the running median of its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, maximum_filter1d, median_filter
from scipy.special import chdtrc

from ambid.arrays import ComplexArray, FloatArray
from ambid.effects.waves import BARELY
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.chance import ADEQUATE, misfit_bound
from ambid.noise.lines import RecordLines, as_lines
from ambid.noise.wave import NEAR, OUTSTANDING, refined_places
from ambid.noise.window import Window

ALONE = 200.0
"""Power of a tone on an excited line over that of its neighbours; a pole is wider than one line."""
SUSPECTED = 1e-3
"""Chance of the power at a frequency that is suspected from the start, such as that of the mains.

What passes is a candidate, and has yet to be significant by its score, at a chance that is smaller still. Of a
frequency that is known, such as the speed, it is asked where nothing else confirms the wave."""
SCREENED = 30.0
"""Power of a line as recorded over the mean of those beside it, below which no line is looked at but the suspects."""
AROUND = 40
"""Lines to each side of a suspected frequency that show what is usual there."""
MAINS = (50.0, 60.0, 100.0, 120.0)
"""Frequencies of the mains and their first harmonics, which are suspected [Hz]."""
NEIGHBOURS = 10
"""Lines to each side for the median."""
BESIDE = np.array([1.0] * 6 + [0.0] * 5 + [1.0] * 6)
"""Lines to each side for the mean: next to a tone, but within the width of a pole."""
BLURRED = 3
"""Lines to each side that hold some of a wave, under a Hann window."""
CYCLES = 2 * NEAR
"""In a record without periods, below which only what is suspected is reported: around fewer, lines are not alike."""
MOST = 8
"""Tones that are reported of a record."""


def find_tones(model: Model, part: RecordLines) -> tuple[Tone, ...]:
    """Tones of what a model leaves of a record, strongest first.

    Parameters
    ----------
    model : Model
    part : RecordLines
        Of two settled periods, where one line alone lies between excited ones, only what is suspected is looked for
        there.
    """
    record, window = part.record, part.window.settled
    here, rate = part.at(model), record.sample_rate
    per_line, turning = rate / window.samples, here.rig.speed / (2.0 * np.pi)
    suspects = _suspects(here, per_line, rate)
    if not window.is_periodic:
        return _without_periods(here, part, suspects)
    looked_at = np.concatenate([_outstanding(part), [int(f / per_line) for f in suspects]]).astype(np.intp)
    between, hidden = Between.around(part, looked_at), _at_narrow_modes(here, window.samples // 2 + 1, per_line, 1)
    found: list[Tone] = []
    while window.periods > 2 and len(found) < MOST:
        line, channel, height = between.loudest(hidden)
        if height < OUTSTANDING:
            break
        places = [tone.frequency_hz / per_line for tone in found]
        *places, place = refined_places(part.measured.quiet, window, [*places, float(line)])
        if abs(place - window.periods * round(place / window.periods)) < BARELY:
            hidden |= np.abs(np.arange(len(hidden)) - line) <= 2
            continue
        found = [replace(tone, frequency_hz=own * per_line) for tone, own in zip(found, places, strict=True)]
        found.append(Tone(place * per_line, channel, height))
        between = Between.around(part, looked_at, found)
    for frequency in sorted(suspects, key=lambda f: between.chance(f / per_line)):
        is_likely = frequency == turning or between.chance(frequency / per_line) < SUSPECTED
        if is_likely and all(abs(frequency - tone.frequency_hz) > 2.0 * per_line for tone in found):
            height, channel = between.at(frequency / per_line)
            found.append(Tone(frequency, channel, height))
    return (*found, *_on_excited_lines(here, part, found))


def _suspects(here: Model, per_line: float, rate: float) -> list[float]:
    """Frequencies that are known before any record [Hz]: of the speed, of effects of the model, of the mains."""
    turning = here.rig.speed / (2.0 * np.pi)
    own = {f for effect in here.acting for f in effect.frequencies_hz(here.rig)} - {turning}
    return [f for f in (turning, *sorted(own), *MAINS) if 2.0 * per_line < f < 0.45 * rate]


def misses_tone(model: Model, part: RecordLines) -> bool:
    """Whether a model leaves a tone on an excited line beside those reported; of one far off it is not alone."""
    if not part.window.is_periodic:
        present = [tone.frequency_hz for tone in part.tones]
        per_line = part.record.sample_rate / part.window.samples
        found = find_tones(model, part)
        if all(any(abs(tone.frequency_hz - f) < per_line for f in present) for tone in found):
            return False
        return bool(confirmed(model, RecordLines(model, part.measured, found, angles=part.angles)))
    return bool(_on_excited_lines(part.at(model), part, part.tones))


def confirmed(model: Model, part: RecordLines) -> tuple[Tone, ...]:
    """The tones of a record's lines that stand out of the noise which is left without them.

    Under a peak of noise a single line may be as loud beside its neighbours; without it the peak is still there. Of a
    tone next to an excited line, little is left between: there that line decides. Without periods, the noise beside a
    model that misses much contains what it misses: there tones are reported where they are most of it.
    """
    window = part.window.settled
    per_line = part.record.sample_rate / window.samples
    if not window.is_periodic:
        return part.tones if _is_else_near(part.at(model), part, part.tones) else ()

    suspects = _suspects(part.at(model), per_line, part.record.sample_rate)

    def stands_out(tone: Tone) -> bool:
        place = tone.frequency_hz / per_line
        nearest = window.periods * round(place / window.periods)
        is_suspected = any(abs(tone.frequency_hz - f) < 0.5 * per_line for f in suspects)
        if is_suspected or abs(place - nearest) < BARELY:  # judged on its excited line
            return True
        around = Between.around(part, np.array([int(place)]))
        if around.over_spectrum(place) > OUTSTANDING:
            return True
        excited = part.window.in_period == round(place / window.periods)
        return bool(abs(place - nearest) < 0.5 and (_alone(part.at(model), part)[excited] > ALONE).any())

    return tuple(tone for tone in part.tones if stands_out(tone))


def _at_narrow_modes(here: Model, count: int, spacing: float, beyond: int) -> NDArray[np.bool_]:
    """Lines next to modes that are narrower than lines are apart: noise that moves such a mode looks like a tone."""
    at, hidden = spacing * np.arange(count), np.zeros(count, dtype=bool)
    poles = here.poles()
    for pole in poles[np.abs(poles.real) < np.pi * spacing]:
        hidden |= np.abs(at - abs(pole.imag) / (2.0 * np.pi)) < (1 + beyond) * spacing
    return hidden


def _outstanding(part: RecordLines) -> NDArray[np.intp]:
    """Unexcited lines that, as they were recorded, stand out among those beside them."""
    window = part.window.settled
    is_between = np.arange(len(part.measured.quiet)) % window.periods != 0
    counted = np.maximum(convolve1d(is_between.astype(float), BESIDE), 1.0)
    stands_out, every = np.zeros(len(is_between), dtype=bool), slice(None, None, window.periods)
    for lines in part.measured.quiet.T:  # one by one: of a long record all are large
        power = _under_hann(np.where(is_between, lines, 0.0), every)
        stands_out |= power > SCREENED * convolve1d(power, BESIDE) / counted
    return np.flatnonzero(stands_out)


def _under_hann(lines: ComplexArray, is_excited: NDArray[np.bool_] | slice) -> FloatArray:
    """Power of the unexcited lines of one channel under a Hann window."""
    hann = lines.copy()
    hann[1:-1] -= 0.5 * (lines[:-2] + lines[2:])
    hann[is_excited] = 0.0
    return hann.real**2 + hann.imag**2


def _on_excited_lines(here: Model, part: RecordLines, found: Sequence[Tone]) -> tuple[Tone, ...]:
    """A tone that falls on an excited line: that line alone stands out among its neighbours."""
    relative, per_line = _alone(here, part, found), part.record.sample_rate / part.window.samples
    line, channel = divmod(int(np.argmax(relative)), relative.shape[1])
    if relative[line, channel] < ALONE:
        return ()
    frequency = float(part.window.excited[line] * per_line)
    mains = [f for f in MAINS if abs(f - frequency) < 0.5 * per_line]
    return (Tone(mains[0] if mains else frequency, channel, float(relative[line, channel])),)


def _without_periods(here: Model, part: RecordLines, suspects: Sequence[float]) -> tuple[Tone, ...]:
    """Lines that a model misses, and that are not excited so; of what is suspected, what stands out less.

    What is not suspected must make many cycles; the speed is always reported.
    """
    window, per_line = part.window, part.record.sample_rate / part.window.samples
    drive = _hann_of(part.drive, part.index).sum(axis=1)
    is_driven = drive > SCREENED * convolve1d(drive, BESIDE / BESIDE.sum())
    hidden = maximum_filter1d(is_driven, 2 * BLURRED + 1)
    hidden[: np.searchsorted(window.excited, CYCLES)] = True
    found: list[Tone] = []
    while len(found) < MOST:
        line, channel, height = _loudest(here, part, found, hidden)
        if height < ALONE:
            break
        found.append(Tone(_between_lines(here, part, int(window.excited[line])) * per_line, channel, height))
    relative = _relative(here, part, found)
    for frequency in suspects:
        line = int(np.argmin(np.abs(window.excited - frequency / per_line)))
        height, channel = float(relative[line].max()), int(np.argmax(relative[line]))
        is_turning = frequency == here.rig.speed / (2.0 * np.pi)
        is_judged = abs(window.excited[line] - frequency / per_line) < 1.0 and not is_driven[line]
        is_likely = is_judged and height > SCREENED
        if (is_turning or is_likely) and all(abs(frequency - tone.frequency_hz) > 2.0 * per_line for tone in found):
            found.append(Tone(frequency, channel, height))
    return tuple(found)


def _is_else_near(here: Model, part: RecordLines, tones: Sequence[Tone]) -> bool:
    """Whether what a model leaves away from some tones is near the noise, or less than what it leaves on them."""
    places = np.array([tone.frequency_hz for tone in tones]) * part.window.samples / part.record.sample_rate
    away = (np.abs(part.index[:, None] - places) > NEAR).all(axis=1)
    p = len(part.record.channels)
    power = np.sum(np.abs(as_lines(part.white(here, []).residual, p)) ** 2, axis=1)
    beside, dof = float(power[away].sum()), 2 * p * max(1, int(away.sum()))
    excess = beside - dof, float(power.sum()) - 2 * p * len(power)
    return beside <= max(ADEQUATE, misfit_bound(dof)) * dof or excess[0] < 0.5 * excess[1]


def _loudest(
    here: Model, part: RecordLines, present: Sequence[Tone], hidden: NDArray[np.bool_]
) -> tuple[int, int, float]:
    """Line, channel and relative power of the line of a record without periods that a model misses most."""
    relative = _relative(here, part, present)
    relative[hidden] = 0.0
    line, channel = divmod(int(np.argmax(relative)), relative.shape[1])
    return line, channel, float(relative[line, channel])


def _relative(here: Model, part: RecordLines, present: Sequence[Tone]) -> FloatArray:
    """Power that a model leaves on lines of a record without periods over that beside them, shape (lines, p).

    As it was recorded: the noise of such a record is estimated from the residual, tones included.
    """
    per_line = part.record.sample_rate / part.window.samples
    power = _hann_of(part.residual_lines(here), part.index)
    power[_at_narrow_modes(here, part.window.samples // 2 + 1, per_line, 1)[part.index]] = 0.0
    for tone in present:
        power[np.abs(part.index * per_line - tone.frequency_hz) < 2 * BLURRED * per_line] = 0.0
    beside = convolve1d(power, BESIDE / BESIDE.sum(), axis=0)
    around = median_filter(power, size=(2 * NEIGHBOURS + 1, 1), mode="nearest") / np.log(2.0)
    return np.asarray(power / np.maximum(np.maximum(around, beside), 1e-300))


def _hann_of(lines: ComplexArray, index: NDArray[np.intp]) -> FloatArray:
    """Power of lines under a Hann window, of those that stand between others without a gap."""
    power, inner = np.abs(lines) ** 2, np.diff(index, n=2, prepend=-2, append=-2) == 0
    inner[1:-1] &= np.diff(index)[:-1] == 1
    inner[[0, -1]] = False
    at = np.flatnonzero(inner)
    power[at] = np.abs(lines[at] - 0.5 * (lines[at - 1] + lines[at + 1])) ** 2
    return np.asarray(power)


def _between_lines(here: Model, part: RecordLines, line: int) -> float:
    """The place of a tone between the lines of a record without periods, if all around it are judged."""
    near = np.arange(max(1, line - NEAR), line + NEAR + 1)
    if not np.isin(near, part.index).all():
        return float(line)
    left = np.zeros((part.window.samples // 2 + 1, len(part.record.channels)), dtype=complex)
    left[part.index] = part.residual_lines(here)
    return refined_places(left, part.window, [float(line)])[0]


def _alone(here: Model, part: RecordLines, present: Sequence[Tone] = ()) -> FloatArray:
    """Power that a model leaves on excited lines over that of the lines beside them, shape (lines, p)."""
    count, per_line = len(part.window.excited), part.record.sample_rate / part.window.samples
    residual = part.white(here, []).residual
    power = np.abs(as_lines(residual, len(part.record.channels))[:count]) ** 2
    spacing = part.window.periods * per_line
    power[_at_narrow_modes(here, (part.window.period + 1) // 2, spacing, 0)[part.window.in_period]] = 0.0
    for tone in present:  # what it spills is not counted again
        power[np.abs(part.window.excited * per_line - tone.frequency_hz) < part.window.periods * per_line] = 0.0
    beside = convolve1d(power, BESIDE / BESIDE.sum(), axis=0)
    if (power < ALONE * beside).all():
        return np.zeros(power.shape)
    around = median_filter(power, size=(2 * NEIGHBOURS + 1, 1), mode="nearest") / np.log(2.0)
    # lines that the transient has been fitted to hold less than noise
    return np.asarray(power / np.maximum(np.maximum(around, beside), 2.0))  # 2 is the mean of noise alone


@dataclass(frozen=True)
class Between:
    """The unexcited lines of the settled periods, the transient taken out, excited ones zero.

    Attributes
    ----------
    window : Window
    lines : ndarray, shape (M N / 2 + 1, p)
        Taken back through the loop, so that noise is smooth over frequency.
    inner : ndarray, shape (excited lines, p, p)
        What whitens them, see `Spectrum`.
    """

    window: Window
    lines: ComplexArray
    inner: ComplexArray

    @classmethod
    def of(cls, part: RecordLines, index: NDArray[np.intp], tones: Sequence[Tone] = ()) -> Between:
        """What the base model of the record's noise, and tones, leave of some unexcited lines; others are zero."""
        window = part.window.settled
        lines = np.zeros((window.samples // 2 + 1, len(part.record.channels)), dtype=complex)
        if len(index):
            lines[index] = part.unexcited.left(index, tones)
        return cls(window, lines, part.spectrum.inner[: len(part.window.excited)])

    @classmethod
    def around(cls, part: RecordLines, places: NDArray[np.intp], tones: Sequence[Tone] = ()) -> Between:
        """The same of the unexcited lines around some lines."""
        window = part.window.settled
        near = np.unique(np.add.outer(places, np.arange(-AROUND, AROUND + 1)))
        inside = (near > 0) & (near < (window.samples + 1) // 2) & (near % window.periods != 0)
        return cls.of(part, near[inside], tones)

    @cached_property
    def power(self) -> FloatArray:
        """Power of the lines under a Hann window over the median of the unexcited ones around, shape (lines, p)."""
        relative = np.zeros(self.lines.shape)
        is_known = np.asarray(self.lines.any(axis=1))
        is_known[1:-1] |= is_known[:-2] | is_known[2:]
        is_known[:: self.window.periods] = False
        # few are; what is further from them than BESIDE reaches counts for nothing
        near = np.flatnonzero(maximum_filter1d(is_known, len(BESIDE) + 2))
        known = is_known[near]
        counted = np.maximum(convolve1d(known.astype(float), BESIDE), 1.0)[known]
        is_excited = near % self.window.periods == 0
        for k, lines in enumerate(self.lines[near].T if len(near) else ()):
            power = _under_hann(lines, is_excited)
            middle = median_filter(power[known], size=2 * NEIGHBOURS + 1, mode="nearest") / np.log(2.0)
            beside = convolve1d(power, BESIDE)[known] / counted
            relative[near[known], k] = power[known] / np.maximum(np.maximum(middle, beside), 1e-300)
        relative[:2] = relative[-2:] = 0.0
        return relative

    def over_spectrum(self, place: float) -> float:
        """Largest power of the lines next to a place, under a Hann window, over that of the noise by the spectrum."""
        near = np.arange(max(int(place) - 1, 1), min(int(place) + 3, len(self.lines) - 1))
        excited = int(np.clip(round(place / self.window.periods) - self.window.lowest, 0, len(self.inner) - 1))
        level = 2.0 * np.sum(np.abs(np.linalg.inv(self.inner[excited])) ** 2, axis=1)
        every = slice(None, None, self.window.periods)
        power = np.stack([_under_hann(lines, every)[near] for lines in self.lines.T], axis=1)
        # power of a line of noise under a Hann window, over that without
        return float(np.max(power / (1.5 * level), initial=0.0))

    def loudest(self, hidden: NDArray[np.bool_]) -> tuple[int, int, float]:
        """Line, channel and relative power of the line that stands out most, of those that are not hidden."""
        seen = np.flatnonzero(self.power.any(axis=1) & ~hidden)
        if not len(seen):
            return 0, 0, 0.0
        row, channel = divmod(int(np.argmax(self.power[seen])), self.power.shape[1])
        return int(seen[row]), channel, float(self.power[seen[row], channel])

    def at(self, line: float) -> tuple[float, int]:
        """Relative power at a place between lines, and the channel where it is largest."""
        own = self.power[round(line)]
        return float(own.max()), int(np.argmax(own))

    def chance(self, line: float) -> float:
        """How likely noise is to reach what the unexcited line nearest to a place holds over all channels."""
        near = [k for k in (int(np.floor(line)), int(np.ceil(line))) if k % self.window.periods and k < len(self.power)]
        if not near:
            return 1.0
        nearest = min(near, key=lambda k: abs(k - line))
        return float(chdtrc(2 * self.power.shape[1], 2.0 * self.power[nearest].sum()))
