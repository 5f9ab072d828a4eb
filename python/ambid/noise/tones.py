"""Lines that stand out between the excited ones: what has a frequency of its own, such as unbalance or mains hum.

The residual less its mean over the periods holds no excited line. Under a Hann window a tone stands in a few lines of
its spectrum, far above the running median of its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import convolve1d, median_filter
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.effect import Tone
from ambid.noise.window import Window

__all__ = ["Tone", "find_tones", "without_tones"]

OUTSTANDING = 70.0
"""Power of a tone over that around it; noise alone reaches 40 in a few of a hundred records of 60 000 lines."""
ALONE = 200.0
"""Power of a tone on an excited line over that of its neighbours; a pole is wider than one line."""
SUSPECTED = 0.2
"""Chance of the power at a frequency that is suspected from the start, such as the speed or that of the mains.

What passes is a candidate and has yet to be significant by its score."""
MAINS = (50.0, 60.0, 100.0, 120.0)
"""Frequencies of the mains and their first harmonics, which are suspected [Hz]."""
NEIGHBOURS = 10
"""Lines to each side for the median."""
BESIDE = np.array([1.0] * 6 + [0.0] * 5 + [1.0] * 6)
"""Lines to each side for the mean: next to a tone, but within the width of a pole."""
MOST = 8
"""Tones that are told of a record."""


def find_tones(
    residual: FloatArray, window: Window, sample_rate: float, axes: int, speed: float, shape: ComplexArray
) -> tuple[Tone, ...]:
    """Tones of a residual, strongest first.

    Parameters
    ----------
    residual : ndarray, shape (samples, p)
        Of the whole record, y of all axes first.
    window : Window
        3 periods or more.
    sample_rate : float
        [Hz]
    axes : int
        Number of axes.
    speed : float
        Of the rotor [rad/s]; a turning rotor has a tone at its frequency, however small.
    shape : ndarray, shape (M N / 2 + 1, p, p)
        What makes the noise of each line smooth over frequency.
    """
    n = window.samples
    left = _unrepeated(window.cut(residual), window)
    per_line = sample_rate / n
    suspects = [f for f in (speed / (2.0 * np.pi), *MAINS) if 2.0 * per_line < f < 0.45 * sample_rate]
    found: list[Tone] = []
    while len(found) < MOST:
        power = _relative_power(left, window, shape)
        power[:2] = power[-2:] = 0.0
        line, channel = divmod(int(np.argmax(power)), power.shape[1])
        frequency = line * per_line
        if power[line, channel] < OUTSTANDING:
            likely = {f: _chance(power, f / per_line, window) for f in suspects}
            frequency = min(likely, key=likely.__getitem__, default=0.0)
            if not likely or likely[frequency] > SUSPECTED:
                break
            suspects.remove(frequency)
            channel = int(np.argmax(power[round(frequency / per_line)]))
            height = float(power[round(frequency / per_line), channel])
        else:
            height = float(power[line, channel])
            frequency = _refined(left, frequency, per_line, window)
            suspects = [f for f in suspects if abs(f - frequency) > 2.0 * per_line]
        found.append(Tone(frequency, channel % axes, height))
        left = _without(left, [_wave(frequency / per_line, window)])
    turning = speed / (2.0 * np.pi)
    if turning in suspects:
        power = _relative_power(left, window, shape)[round(turning / per_line)]
        found.append(Tone(turning, int(np.argmax(power)) % axes, float(power.max())))
    return (*found, *_on_excited_lines(residual, window, per_line, axes, shape))


def _on_excited_lines(
    residual: FloatArray, window: Window, per_line: float, axes: int, shape: ComplexArray
) -> tuple[Tone, ...]:
    """A tone that falls on an excited line: that line alone stands out among its neighbours."""
    lines = (shape @ window.lines(residual)[..., None])[..., 0]
    power = np.abs(lines[window.excited]) ** 2
    around = median_filter(power, size=(2 * NEIGHBOURS + 1, 1), mode="nearest") / np.log(2.0)
    beside = convolve1d(power, BESIDE / BESIDE.sum(), axis=0)
    relative = power / np.maximum(np.maximum(around, beside), 1e-300)
    line, channel = divmod(int(np.argmax(relative)), relative.shape[1])
    if relative[line, channel] < ALONE:
        return ()
    frequency = float(window.excited[line] * per_line)
    mains = [f for f in MAINS if abs(f - frequency) < 0.5 * per_line]
    return (Tone(mains[0] if mains else frequency, channel % axes, float(relative[line, channel])),)


def without_tones(signal: FloatArray, tones: Sequence[Tone], window: Window, sample_rate: float) -> FloatArray:
    """A signal less what the least squares of sine and cosine find at the tones' frequencies after its first period."""
    if not tones:
        return signal
    out = signal.copy()
    unrepeated = _unrepeated(window.cut(signal), window)
    waves = [_wave(tone.frequency_hz * window.samples / sample_rate, window) for tone in tones]
    out[window.period : window.period + window.samples] -= unrepeated - _without(unrepeated, waves)
    return out


def _relative_power(signal: FloatArray, window: Window, shape: ComplexArray) -> FloatArray:
    """Power of the lines over the median of the unexcited ones around, shape (lines, p)."""
    hann = np.hanning(len(signal) + 1)[:-1, None]
    power = np.abs((shape @ rfft(signal * hann, axis=0)[..., None])[..., 0]) ** 2
    power[:: window.periods] = 0.0
    between = np.arange(len(power)) % window.periods != 0
    middle = np.zeros_like(power)
    middle[between] = median_filter(power[between], size=(2 * NEIGHBOURS + 1, 1), mode="nearest") / np.log(2.0)
    beside = convolve1d(power, BESIDE, axis=0) / np.maximum(convolve1d(between.astype(float), BESIDE), 1.0)[:, None]
    around = np.maximum(middle, beside)
    return np.where(between[:, None] & (around > 0.0), power / np.where(around > 0.0, around, 1.0), 0.0)


def _chance(power: FloatArray, line: float, window: Window) -> float:
    """How likely noise is to reach what the unexcited line nearest to a frequency holds over all channels."""
    near = [k for k in (int(np.floor(line)), int(np.ceil(line))) if k % window.periods and k < len(power)]
    if not near:
        return 1.0
    nearest = min(near, key=lambda k: abs(k - line))
    return float(chdtrc(2 * power.shape[1], 2.0 * power[nearest].sum()))


def _refined(signal: FloatArray, frequency: float, per_line: float, window: Window) -> float:
    """Frequency whose sine and cosine explain most of all channels, within a line to each side."""
    scaled = signal / signal.std(axis=0)

    def explained(line: float) -> float:
        wave = _wave(line, window)
        return -float(np.sum(np.abs(wave.conj() @ scaled) ** 2) / np.sum(np.abs(wave) ** 2))

    at = frequency / per_line
    found = minimize_scalar(explained, bounds=(at - 1.0, at + 1.0), method="bounded", options={"xatol": 1e-5})
    return float(found.x) * per_line


def _wave(line: float, window: Window) -> ComplexArray:
    """What is left of a tone, of unit amplitude, when its mean over the periods is taken out."""
    return _unrepeated(np.exp(2j * np.pi * line / window.samples * np.arange(window.samples)), window)


def _unrepeated(signal: Any, window: Window) -> Any:
    """A signal of the part of the record that counts, less its mean over the periods."""
    periods = signal.reshape(window.periods, window.period, -1)
    return (periods - periods.mean(axis=0)).reshape(signal.shape)


def _without(signal: FloatArray, waves: Sequence[ComplexArray]) -> FloatArray:
    table = np.column_stack([part for wave in waves for part in (wave.real, wave.imag)])
    return signal - table @ np.linalg.lstsq(table, signal, rcond=None)[0]
