"""Excitation currents i_e to be played on a machine: pseudo-random binary sequences and multisines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambid.errors import InputError

__all__ = ["multisine", "prbs"]


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
    _require_integer("order", order, 2, 24)
    _require_positive("amplitude", amplitude, "A")
    for key, value in (("hold", hold), ("axes", axes), ("periods", periods)):
        _require_integer(key, value, 1)
    chips = 2**order - 1
    if shifts is None:
        shifts = [axis * chips // axes for axis in range(axes)]
    delays = np.asarray(shifts)
    if delays.shape != (axes,) or delays.dtype.kind not in "iu":
        raise InputError(f"shifts = {list(shifts)}: give one whole number of chips for each of the {axes} axes")
    if len(set(delays % chips)) < axes:
        raise InputError(
            f"shifts = {list(shifts)}: two of the {axes} axes carry the same signal (period {chips} chips) and "
            "cannot be told apart; give different shifts or a higher order"
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
    axes: int = 1,
    periods: int = 1,
    phases: str = "schroeder",
    seed: int = 0,
) -> NDArray[np.float64]:
    """Multisines with a flat spectrum on chosen lines; several axes share the lines out between them (zippered).

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
    axes : int
        Number of columns; axis j has the lines j, j + axes, j + 2 axes, ... of the list, so that no two axes share one
        and each response on a line belongs to one axis.
    periods : int
        Number of whole periods.
    phases : {"schroeder", "random"}
        Schroeder phases have a low crest factor; random phases make the amplitude distribution nearly Gaussian.
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
    Source: Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85; Rivera et al., zippered multisines, Chem. Eng. Sci. (2009).
    """
    for key, value, least in (("period", period, 4), ("axes", axes, 1), ("periods", periods, 1)):
        _require_integer(key, value, least)
    _require_positive("rms", rms, "A")
    if phases not in ("schroeder", "random"):
        raise InputError(f"phases = {phases!r}: allowed are 'schroeder' and 'random'")
    excited = _excited_lines(period, lines, band_hz, sample_rate)
    if excited.size < axes:
        raise InputError(f"{excited.size} excited lines for {axes} axes: each axis needs one of its own; add lines")
    rng = np.random.default_rng(seed)
    spectrum = np.zeros((period // 2 + 1, axes), dtype=complex)
    for axis in range(axes):
        own = excited[axis::axes]
        rank = np.arange(own.size)
        phase = -np.pi * rank * (rank + 1) / own.size if phases == "schroeder" else rng.uniform(0, 2 * np.pi, own.size)
        spectrum[own, axis] = rms * np.sqrt(2 / own.size) * period / 2 * np.exp(1j * phase)
    return np.tile(np.fft.irfft(spectrum, n=period, axis=0), (periods, 1))


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
