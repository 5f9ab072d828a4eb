"""Excitation currents i_e: designed (PRBS, multisine), recognised (period) and rebuilt where they were not logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import schur

from ambid.errors import InputError, RecordError

if TYPE_CHECKING:
    from ambid.record import Record
    from ambid.rig import Rig

# A rebuilt i_e carries the noise of its sources: two of its periods agree less well than those of a logged one.
REBUILT_TOLERANCE = 0.6


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


def find_period(i_e: ArrayLike, *, tolerance: float = 1e-3) -> int | None:
    """Smallest number of samples after which the excitation of all axes repeats.

    The mismatch of a lag P is ||x[k + P] - x[k]|| / ||x||, the worst over the axes, computed for all lags at once from
    the autocorrelation. A logged excitation repeats exactly, a measured one up to its noise: the answer is the smallest
    lag as good as the best, and no worse than the tolerance.

    Parameters
    ----------
    i_e : array_like, shape (N,) or (N, axes)
        Excitation currents [A]. An axis whose rms is below 1e-3 of the largest counts as not excited.
    tolerance : float
        Largest relative rms mismatch between one period and the next.

    Returns
    -------
    int or None
        Period in samples, at most N // 2 (two whole periods); None if there is none.
    """
    x = np.asarray(i_e, dtype=np.float64)
    samples = len(x)
    x = x.reshape(samples, -1)
    if samples < 2 or not np.any(np.ptp(x, axis=0)):
        return None
    x = x - x.mean(axis=0)
    rms = np.sqrt(np.mean(x**2, axis=0))
    x = x[:, rms > 1e-3 * rms.max()] / rms[rms > 1e-3 * rms.max()]
    lags = np.arange(1, samples // 2 + 1)
    spectrum = np.fft.rfft(x, n=2 * samples, axis=0)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2, n=2 * samples, axis=0)[lags]
    energy = np.cumsum(x**2, axis=0)
    overlap = energy[samples - 1 - lags] + energy[-1] - energy[lags - 1]
    mismatch = np.sqrt(np.clip(2 - 4 * correlation / overlap, 0, None).max(axis=1))
    # Without a mean, a signal is uncorrelated with itself somewhere in every period: the search starts there, past the
    # lags at which a slow signal merely resembles itself, and ends where it is lost again.
    unlike = np.flatnonzero(mismatch >= 1.0)
    if unlike.size == 0:
        return None
    # All multiples of the period are equally good up to the noise: four standard errors of a mismatch.
    best = mismatch[unlike[0] :].min()
    limit = min(tolerance, max((1 + 4 / np.sqrt(samples)) * best, 0.01 * tolerance))
    good = np.flatnonzero(mismatch <= limit)
    good = good[good > unlike[0]]
    if good.size == 0:
        return None
    end = unlike[np.searchsorted(unlike, good[0])] if unlike[-1] > good[0] else len(lags)
    return int(lags[good[0] + np.argmin(mismatch[good[0] : end])])


def rebuild_excitation(record: Record, rig: Rig) -> Record:
    """Recover i_e = i_ref + K y where it was not logged, with the controller K of the rig.

    From a recorded command i_ref this is direct. From the current i_c the amplifier's lag is inverted for a held input,
    i_c[k+1] = a i_c[k] + (1 - a) i_ref[k] with a = exp(-dt / tau_a), which amplifies the noise of i_c. An analog K acts
    on y taken as linear between the samples (first-order hold). A digital K is exact; the recorded command comes after
    its delay, of which the whole samples are undone. Samples of i_e that act only after the end of the
    record are continued periodically, or repeat the last one.

    Parameters
    ----------
    record : Record
        With y, and i_ref or i_c; an i_e that it has is replaced.
    rig : Rig
        Its `controller` and, for i_c, `amplifier.time_constant` are used.

    Returns
    -------
    Record
        The same record with i_e, its period, and a note that says what it was rebuilt from.

    Raises
    ------
    RecordError
        If neither i_ref nor i_c was recorded, the controller runs at another rate than the record, or the result
        drifts: y is not what the integrator saw.

    Notes
    -----
    The integrator's state before the record is not known, and it acts as a constant added to i_e. With an integrating K
    the mean of i_e is therefore set to zero.
    """
    where = str(record.path or record.name)
    controller = rig.controller
    i_e, source, integrating = _recover(record, rig, where)
    note = f"i_e was not logged: rebuilt from {source}, y and the rig's {controller.implementation} controller"
    if lost := controller.delay_samples % 1:
        note += f"; {lost:.3g} sample of its delay is not undone"
    period = record.period or find_period(i_e, tolerance=REBUILT_TOLERANCE)
    if integrating:
        _refuse_drift(i_e, record, where)
        mean = i_e[: len(i_e) // period * period if period else None].mean(axis=0)
        i_e = i_e - mean
        note += f"; its mean ({', '.join(f'{m:.3g}' for m in mean)} A, the integrator's operating point) was removed"
    while (missing := record.samples - len(i_e)) > 0:
        tail = i_e[-period:][:missing] if period else np.repeat(i_e[-1:], missing, axis=0)
        i_e = np.concatenate([i_e, tail])
    return replace(record, i_e=i_e, period=period, notes=(*record.notes, note))


def _recover(record: Record, rig: Rig, where: str) -> tuple[NDArray[np.float64], str, bool]:
    """Return i_e as far as it acts within the record, what it was recovered from, and whether K integrates."""
    controller, rate = rig.controller, record.sample_rate
    command, source = record.i_ref, "the recorded command i_ref"
    if command is None:
        command, source = record.i_c, "i_c"
    if command is None:
        raise RecordError(f"{where}: i_e is missing, and i_ref and i_c to rebuild it from are too; record one of them")
    if controller.is_digital and abs(controller.rate(rate) - rate) > 1e-6 * rate:
        raise RecordError(
            f"{where}: i_e cannot be rebuilt: the controller runs at {controller.rate(rate):g} Hz, "
            f"the record at {rate:g} Hz; log i_e, or record at the controller's rate"
        )
    K = controller.state_space(len(record.axes), rate)
    tau_a = rig.amplifier.time_constant if record.i_ref is None else 0.0
    if not controller.is_digital:
        from scipy.signal import cont2discrete  # slow to import, and seldom needed

        # What K adds between the samples goes through the amplifier with it; only the held i_e is left to invert for.
        K = cont2discrete(_then_lag(K, tau_a) if tau_a else K, 1 / rate, method="foh")[:4]
        feedback, integrating = _response(K, record.y)
        command = command + feedback
    if tau_a:
        a = np.exp(-1 / (rate * tau_a))
        command = (command[1:] - a * command[:-1]) / (1 - a)
        source += f" (its noise is amplified {np.sqrt(1 + a**2) / (1 - a):.2g} times by undoing the amplifier's lag)"
    if controller.is_digital:
        feedback, integrating = _response(K, record.y)
        command = command[int(controller.delay_samples) :]
        command = command + feedback[: len(command)]
    return command, source, integrating


def _response(K: tuple[NDArray[np.float64], ...], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool]:
    """Return K y, shape (N, outputs), for discrete K = (A, B, C, D) at rest before y[0], and whether K integrates.

    The Schur form makes A triangular, so that each state is one scalar recursion driven by the later ones.
    """
    from scipy.signal import lfilter  # slow to import, and seldom needed

    A, B, C, D = K
    if A.size == 0:
        return y @ D.T, False
    integrating = bool(np.any(np.abs(np.linalg.eigvals(A) - 1) < 1e-9))
    # At rest the rotor sits at its operating point, not at zero: without an integrator K has settled there.
    operating_point = 0.0 * y[0] if integrating else y.mean(axis=0)
    gain = D if integrating else C @ np.linalg.solve(np.eye(len(A)) - A, B) + D
    u = y - operating_point
    T, Z = schur(A, output="complex")
    forcing = u @ (Z.conj().T @ B).T
    x = np.zeros_like(forcing)
    for j in reversed(range(len(T))):
        x[:, j] = lfilter([0, 1], [1, -T[j, j]], forcing[:, j] + x[:, j + 1 :] @ T[j, j + 1 :])
    return (x @ (C @ Z).T).real + u @ D.T + operating_point @ gain.T, integrating


def _then_lag(K: tuple[NDArray[np.float64], ...], tau: float) -> tuple[NDArray[np.float64], ...]:
    """Continuous K followed by a first-order lag [s] on each output."""
    A, B, C, D = K
    states, outputs = len(A), len(C)
    eye = np.eye(outputs)
    return (
        np.block([[A, np.zeros((states, outputs))], [C / tau, -eye / tau]]),
        np.vstack([B, D / tau]),
        np.hstack([np.zeros((outputs, states)), eye]),
        np.zeros_like(D),
    )


def _refuse_drift(i_e: NDArray[np.float64], record: Record, where: str) -> None:
    """Raise where the rebuilt i_e is mostly a ramp: K integrated an offset of y that the real one did not see."""
    time = np.linspace(-0.5, 0.5, len(i_e))
    drift = np.abs(12 * (time @ i_e) / len(i_e))
    for axis, ramp, spread, offset in zip(record.axes, drift, i_e.std(axis=0), record.y.mean(axis=0), strict=True):
        if ramp > 2 * spread:
            raise RecordError(
                f"{where}: i_e.{axis} rebuilt from y drifts by {ramp:.3g} A over the record: the mean of y.{axis}, "
                f"{offset:.3g} m, is not what the integrator saw; subtract the controller's set point from y"
            )


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
