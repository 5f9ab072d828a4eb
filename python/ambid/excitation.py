"""Excitation currents i_e to be played on a machine: pseudo-random binary sequences and multisines."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.errors import InputError

PRBS, MULTISINE = "prbs", "multisine"
"""Kinds of signals."""
MOST_ORDER = 24
"""Of a shift register: a period of 17 million chips."""
FINER = 4
"""Times as many samples as the period has, where it is clipped with few lines: the peaks between samples count too."""


def prbs(
    order: int,
    *,
    amplitude: float,
    hold: int = 1,
    axes: int = 1,
    periods: int = 1,
    shifts: Sequence[int] | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Pseudo-random binary sequences of maximum length, one shifted copy per axis.

    Parameters
    ----------
    order : int
        Length of the shift register, 2 to 24; one period has 2**order - 1 chips.
    amplitude : float
        The current switches between +amplitude and -amplitude [A].
    hold : int
        Samples per chip; the spectrum has its first zero at sample_rate / hold.
    axes : int
        Number of columns.
    periods : int
        Number of whole periods.
    shifts : sequence of int, optional
        Delay of each axis in chips, no two alike; by default they are spread evenly over the period.
    seed : int
        Chooses the state that the register starts from, that is, a common shift.

    Returns
    -------
    ndarray, shape (periods * (2**order - 1) * hold, axes)
        Excitation currents [A].

    Raises
    ------
    InputError
        If an argument is out of its range, or two axes would carry the same signal.

    Notes
    -----
    Primitive polynomials are those of `scipy.signal.max_len_seq`. Source: Golomb, Shift Register Sequences (1967).
    """
    _require_integer("order", order, 2, MOST_ORDER)
    _require_positive("amplitude", amplitude, "A")
    for key, value, least in (("hold", hold, 1), ("axes", axes, 1), ("periods", periods, 1), ("seed", seed, 0)):
        _require_integer(key, value, least)
    chips = 2**order - 1
    if shifts is None:
        shifts = [axis * chips // axes for axis in range(axes)]
    delays = np.asarray(shifts)
    if delays.shape != (axes,) or delays.dtype.kind not in "iu":
        raise InputError(f"shifts = {list(shifts)}: give one whole number of chips for each of the {axes} axes")
    if len(set(delays % chips)) < axes:
        raise InputError(
            f"shifts = {list(shifts)}: two of the {axes} axes carry the same signal (period {chips} chips) and "
            "cannot be distinguished; give different shifts or a higher order"
        )
    start = int(np.random.default_rng(seed).integers(1, chips + 1))
    state = [start >> bit & 1 for bit in range(order)]
    from scipy.signal import max_len_seq  # slow to import, and seldom needed

    sequence = max_len_seq(order, state=state)[0]
    columns = np.stack([np.roll(sequence, delay) for delay in delays], axis=1)
    levels = np.where(columns, float(amplitude), -float(amplitude))
    return np.tile(np.repeat(levels, hold, axis=0), (periods, 1))


def multisine(
    period: int,
    *,
    rms: float,
    lines: Sequence[int] | None = None,
    band_hz: tuple[float, float] | None = None,
    sample_rate: float | None = None,
    powers: ArrayLike | None = None,
    axes: int = 1,
    periods: int = 1,
    phases: str = "schroeder",
    seed: int = 0,
) -> NDArray[np.float64]:
    """Multisines on chosen lines; several axes share the lines out between them (zippered).

    Parameters
    ----------
    period : int
        Samples per period; line l is at l * sample_rate / period.
    rms : float
        Root mean square of every axis [A]. The peak follows from the phases.
    lines : sequence of int, optional
        Excited lines, from 1 to below period / 2, each once. Either these or `band_hz`.
    band_hz : (float, float), optional
        Lowest and highest frequency [Hz]; every line in between is excited. Needs `sample_rate` [Hz].
    sample_rate : float, optional
        Of the signal [Hz]; only with `band_hz`.
    powers : array_like, shape (lines,), optional
        Relative power of each of `lines`, in their order; flat by default.
    axes : int
        Number of columns; axis j has the lines j, j + axes, j + 2 axes, ... of the list, so that no two axes share one
        and each response on a line belongs to one axis.
    periods : int
        Number of whole periods.
    phases : {"schroeder", "random", "clipped"}
        Schroeder phases have a low crest factor; from them clipping finds phases with a lower one; random phases make
        the amplitude distribution nearly Gaussian.
    seed : int
        Of the random phases.

    Returns
    -------
    ndarray, shape (periods * period, axes)
        Excitation currents [A].

    Raises
    ------
    InputError
        If an argument is out of its range.

    Notes
    -----
    Source: Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85; Van der Ouderaa et al., clipping, IEEE Trans. Instrum.
    Meas. 37 (1988) 145; Rivera et al., zippered multisines, Chem. Eng. Sci. (2009).
    """
    for key, value, least in (("period", period, 4), ("axes", axes, 1), ("periods", periods, 1), ("seed", seed, 0)):
        _require_integer(key, value, least)
    _require_positive("rms", rms, "A")
    if phases not in ("schroeder", "random", "clipped"):
        raise InputError(f"phases = {phases!r}: allowed are 'schroeder', 'random' and 'clipped'")
    excited = _excited_lines(period, lines, band_hz, sample_rate)
    if excited.size < axes:
        raise InputError(f"{excited.size} excited lines for {axes} axes: each axis needs one of its own; add lines")
    share = _shares(powers, lines, excited)
    rng = np.random.default_rng(seed)
    columns = []
    for axis in range(axes):
        own, part = excited[axis::axes], share[axis::axes] / share[axis::axes].sum()
        phase = rng.uniform(0, 2 * np.pi, own.size) if phases == "random" else _schroeder(part)
        size = rms * np.sqrt(2.0 * part) * period / 2
        if phases == "clipped":
            phase = _clipped(period, own, size, phase)
        columns.append(_wave(period, own, size, phase, period))
    return np.tile(np.stack(columns, axis=1), (periods, 1))


def _schroeder(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phases of lines with these parts of the power: each line sounds in its own part of the period."""
    return -2.0 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(share))[:-1]])


def _wave(
    period: int, lines: NDArray[np.int64], size: NDArray[np.float64], phase: NDArray[np.float64], samples: int
) -> NDArray[np.float64]:
    """One period in so many samples of lines with magnitudes as a transform of `period` samples has them."""
    spectrum = np.zeros(samples // 2 + 1, dtype=complex)
    spectrum[lines] = size * np.exp(1j * phase) * (samples / period)
    return np.asarray(np.fft.irfft(spectrum, n=samples))


def _clipped(
    period: int, lines: NDArray[np.int64], size: NDArray[np.float64], phase: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Phases with a lower peak: the peaks are clipped, the magnitudes put back, and so on; the best ones count."""
    samples = FINER * period if FINER * lines.max() < period else period
    best, lowest = phase, np.inf
    # rounds of clipping that lower a crest factor; twice as many gain less than a twentieth on 6 to 900 lines
    # part of the peak at which the first round clips; the last clips at the peak
    for clip in np.linspace(0.4, 1.0, 200):
        wave = _wave(period, lines, size, phase, samples)
        peak = float(np.abs(wave).max())
        if peak < lowest:
            best, lowest = phase, peak
        phase = np.angle(np.fft.rfft(np.clip(wave, -clip * peak, clip * peak))[lines])
    return best


def _shares(powers: ArrayLike | None, lines: Sequence[int] | None, excited: NDArray[np.int64]) -> NDArray[np.float64]:
    """Relative powers in the order of the sorted lines."""
    if powers is None:
        return np.ones(excited.size)
    if lines is None:
        raise InputError("powers are of lines; give the lines too")
    found = np.asarray(powers, dtype=np.float64)
    if found.shape != excited.shape or not (np.isfinite(found).all() and (found > 0.0).all()):
        raise InputError(f"powers: give a finite number above zero for each of the {excited.size} lines")
    return np.asarray(found[np.argsort(lines)])


def _excited_lines(
    period: int, lines: Sequence[int] | None, band_hz: tuple[float, float] | None, sample_rate: float | None
) -> NDArray[np.int64]:
    """Sorted excited lines, from either way of asking for them."""
    if (lines is None) == (band_hz is None):
        raise InputError("give the excited lines either as lines or as band_hz, not both")
    if band_hz is not None:
        if sample_rate is None:
            raise InputError("band_hz needs sample_rate")
        _require_positive("sample_rate", sample_rate, "Hz")
        low, high = band_hz
        if not 0 < low <= high < sample_rate / 2:
            raise InputError(f"band_hz = {band_hz}: allowed is 0 < lowest <= highest < {sample_rate / 2:g} Hz")
        resolution = sample_rate / period
        # Band edges that are lines themselves belong to the band, whatever the last bit of the division.
        excited = np.arange(np.ceil(low / resolution - 1e-9), np.floor(high / resolution + 1e-9) + 1).astype(np.int64)
        if excited.size == 0:
            raise InputError(f"band_hz = {band_hz} holds no line (every {resolution:g} Hz); lengthen the period")
        return excited
    excited = np.asarray(lines)
    if excited.ndim != 1 or excited.size == 0 or excited.dtype.kind not in "iu":
        raise InputError(f"lines = {lines}: give a list of whole numbers")
    if excited.min() < 1 or 2 * excited.max() >= period or len(set(excited.tolist())) < excited.size:
        raise InputError(f"lines = {lines}: each from 1 to below period / 2 = {period / 2:g}, and once")
    return np.sort(excited)


def _require_integer(key: str, value: object, least: int, most: int | None = None) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least or (most and value > most):
        allowed = f"from {least} to {most}" if most else f"from {least} on"
        raise InputError(f"{key} = {value!r}: allowed are whole numbers {allowed}")


def _require_positive(key: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{key} = {value!r} {unit}: allowed is a finite value above zero")
