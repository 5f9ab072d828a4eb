"""The excitation i_e of a record where it was not logged, from the recorded command or current and the controller."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import schur

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind
from ambid.record.command_delay import CommandDelay, by_current, by_law
from ambid.record.free_modes import HOLDS, REBUILT_TOLERANCE, free_modes, is_held, without_free_modes
from ambid.record.repeats import find_period
from ambid.record.rounding import step_of
from ambid.rig import Rig

ExcitationSource = Literal[
    "logged", "applied_command", "rebuilt_from_command", "rebuilt_from_current", "assumed_zero", "unknown"
]
"""Where i_e of a record is from; ``applied_command`` was logged, but is as the recorded command applied it."""
REBUILT = Kind(
    "excitation_rebuilt",
    "note",
    "i_e was not logged: rebuilt from {source}[ (its noise is amplified {noise_gain:.2g} times by undoing the "
    "amplifier's lag)], {signals} "
    "and the rig's {implementation} controller[; {delay_left_samples:.3g} sample of its delay is not undone][; its "
    "mean ({means:.3g} {unit}, the integrator's operating point), and what the controller's states held when the "
    "record begins, were removed]",
)
COMMAND_FOLLOWS = Kind(
    "command_follows_controller",
    "note",
    "i_e was not logged: the recorded command follows from {signals} by the rig's controller to {share:.1g}, and i_e "
    "is taken as zero[: the reference {reference} drives the loop]",
)
SAME = 1e-3
"""Part of the recorded command up to which what the law leaves is its rounding, and no excitation."""


class Rebuilt(NamedTuple):
    """A rebuilt excitation, shape (N, axes) [A], its period in samples, and what it was rebuilt from."""

    i_e: FloatArray
    period: int | None
    source: ExcitationSource
    findings: tuple[Finding, ...]


def rebuild_excitation(
    rig: Rig,
    sample_rate: float,
    *,
    y: FloatArray,
    i_ref: FloatArray | None = None,
    i_c: FloatArray | None = None,
    r: FloatArray | None = None,
    period: int | None = None,
    where: str = "record",
) -> Rebuilt:
    """Recover i_e = i_ref + K y where it was not logged, with the controller K of the rig, which may act on y - r.

    From a recorded command i_ref this is direct. From the current i_c the amplifier's lag is inverted for a held input,
    i_c[k+1] = a i_c[k] + (1 - a) i_ref[k] with a = exp(-dt / tau_a), which amplifies the noise of i_c. An analog K acts
    on y taken as linear between the samples (first-order hold). A digital K is exact; the recorded command comes after
    its delay, of which the whole samples are undone, unless i_c follows it later by as many: then it was recorded
    before. Samples of i_e that act only after the end of the record are continued periodically, or repeat the last one.

    Parameters
    ----------
    rig : Rig
        Its `axes`, `controller` and, for i_c, `amplifier.time_constant` are used.
    sample_rate : float
        Of the record [Hz].
    y : ndarray, shape (N, axes)
        Displacements [m].
    i_ref, i_c : ndarray, shape (N, axes), optional
        Command and current [A]; the command is taken where both are given.
    r : ndarray, shape (N, axes), optional
        Reference of a controller that has one [m]; a constant where it was not recorded. One that does not move
        drives nothing: it is where y stands.
    period : int, optional
        Samples per period; by default it is found from the result.
    where : str
        The record, in messages.

    Raises
    ------
    RecordError
        If neither i_ref nor i_c was recorded, nor a current that the controller reads, the controller runs at another
        rate than the record, or the result drifts: y is not what the integrator saw.

    Notes
    -----
    What the controller's states held before the record is not known: its free response is taken off
    (`without_free_modes`), of which that of an integrator is a constant. With an integrating K the mean of i_e is zero.
    """
    controller = rig.controller
    is_led = r is not None and bool(np.any(r != r[:1]))
    read = _read(rig, y, i_c, r, where)
    i_e, how, integrating = _recover(rig, sample_rate, read, i_ref, i_c, where, y=y, period=period)
    findings = how.pop("findings", ())
    signals = ["y"] if r is None else ["y", "r"]
    if i_ref is not None and (left := _follows(i_e, i_ref)) is not None:
        follows = COMMAND_FOLLOWS(signals=signals, share=left, reference="r" if is_led else None)
        return Rebuilt(np.zeros_like(y), period, "assumed_zero", (follows, *findings))
    how |= {"signals": signals, "implementation": controller.implementation}
    how |= {"delay_left_samples": controller.delay_samples % 1 or None}
    period = period or find_period(i_e, tolerance=REBUILT_TOLERANCE)
    steps = None if i_ref is None else steps_of(i_e, rounding_of(i_ref))
    if is_led and steps is not None:
        i_e = steps
    if integrating:
        if not is_led:
            _refuse_drift(i_e if steps is None else i_e - steps, i_e, y if r is None else y - r, rig, where)
        mean = i_e[: len(i_e) // period * period if period else None].mean(axis=0)
        i_e = i_e - mean
        how |= {"means": mean.tolist(), "unit": rig.amplifier.command_unit}
    while (missing := len(y) - len(i_e)) > 0:
        tail = i_e[-period:][:missing] if period else np.repeat(i_e[-1:], missing, axis=0)
        i_e = np.concatenate([i_e, tail])
    source: ExcitationSource = "rebuilt_from_current" if i_ref is None else "rebuilt_from_command"
    return Rebuilt(i_e, period, source, (REBUILT(**how), *findings))


def unexplained(
    rig: Rig,
    sample_rate: float,
    *,
    y: FloatArray,
    i_ref: FloatArray | None = None,
    i_c: FloatArray | None = None,
    r: FloatArray | None = None,
    i_e: FloatArray | None = None,
    where: str = "record",
) -> FloatArray:
    """What the law of the rig's controller and a logged i_e leave of a recorded command, shape (up to N, axes).

    It begins where the delay of the command ends, and is known up to a constant. Parameters and errors are those of
    `rebuild_excitation`.
    """
    return _recover(rig, sample_rate, _read(rig, y, i_c, r, where), i_ref, i_c, where, y=y, i_e=i_e)[0]


def commanded(
    rig: Rig,
    sample_rate: float,
    *,
    y: FloatArray,
    i_c: FloatArray | None = None,
    r: FloatArray | None = None,
    where: str = "record",
) -> FloatArray:
    """What the rig's digital controller, at rest before, makes of a record without its delay, shape (N, axes).

    In the unit of its command, [A] or [V]. Parameters and errors are those of `rebuild_excitation`; the record is at
    the controller's rate.
    """
    K = rig.controller.state_space(len(rig.axes), sample_rate)
    return -_response(K, _read(rig, y, i_c, r, where))[0]


def _read(rig: Rig, y: FloatArray, i_c: FloatArray | None, r: FloatArray | None, where: str) -> FloatArray:
    """What the controller reads, signal by signal, shape (N, signals axes)."""
    if i_c is None and "i_c" in rig.controller.signals:
        raise RecordError(f"{where}: i_e is missing, and i_c, which the controller reads, is too; record one of them")
    reference = np.zeros_like(y) if r is None else r
    signals = {"y": y - reference if rig.controller.reference else y, "i_c": i_c, "r": reference}
    return np.hstack([own for name in rig.controller.signals if (own := signals[name]) is not None])


def rounding_of(command: FloatArray) -> FloatArray:
    """Change of a command from sample to sample that is rounding of it, or of the converter that made it, (axes,)."""
    size = np.abs(np.diff(command, axis=0)).mean(axis=0)
    return np.maximum(SAME * size, [2.0 * step_of(own) for own in command.T])


def steps_of(i_e: FloatArray, rounding: FloatArray) -> FloatArray | None:
    """The same, held where it changes by no more than rounding of the command does; None where it hardly ever holds.

    What is left there is a small part of y itself, which would pass for what drives it.
    """
    held = is_held(i_e, rounding)
    if held.mean() <= HOLDS:
        return None
    change = np.where(held, 0.0, np.diff(i_e, axis=0, prepend=i_e[:1]))
    return np.asarray(i_e[:1] + np.cumsum(change, axis=0))


def _follows(i_e: FloatArray, i_ref: FloatArray) -> float | None:
    """Part of the command, by rms without its mean, that the law leaves on the worst axis; None for more than rounding.

    Rounding is small, or within a step of the converter.
    """
    own = i_ref[len(i_ref) - len(i_e) :]
    left, size = i_e - i_e.mean(axis=0), np.maximum(own.std(axis=0), 1e-300)
    steps = np.array([step_of(column) for column in own.T])
    is_rounding = (left.std(axis=0) < SAME * size) | (np.abs(left).max(axis=0) <= 1.01 * steps)
    return float(np.max(left.std(axis=0) / size)) if is_rounding.all() else None


def _recover(
    rig: Rig,
    rate: float,
    read: FloatArray,
    i_ref: FloatArray | None,
    i_c: FloatArray | None,
    where: str,
    *,
    y: FloatArray,
    i_e: FloatArray | None = None,
    period: int | None = None,
) -> tuple[FloatArray, dict[str, Any], bool]:
    """Return i_e as far as it acts within the record, what it was recovered from, and whether K integrates."""
    controller = rig.controller
    command = i_c if i_ref is None else i_ref
    how: dict[str, Any] = {"source": "i_c" if i_ref is None else "i_ref"}
    if command is None:
        raise RecordError(f"{where}: i_e is missing, and i_ref and i_c to rebuild it from are too; record one of them")
    if controller.is_digital and abs(controller.rate(rate) - rate) > 1e-6 * rate:
        raise RecordError(
            f"{where}: i_e cannot be rebuilt: the controller runs at {controller.rate(rate):g} Hz, "
            f"the record at {rate:g} Hz; log i_e, or record at the controller's rate"
        )
    K = controller.state_space(len(rig.axes), rate)
    tau_a = rig.amplifier.time_constant if i_ref is None else 0.0
    if not controller.is_digital:
        from scipy.signal import cont2discrete  # slow to import, and seldom needed

        # What K adds between the samples goes through the amplifier with it; only the held i_e is left to invert for.
        K = cont2discrete(_then_lag(K, tau_a) if tau_a else K, 1 / rate, method="foh")[:4]
        feedback, integrating = _response(K, read)
        command = command + feedback
    if tau_a:
        a = np.exp(-1 / (rate * tau_a))
        command = (command[1:] - a * command[:-1]) / (1 - a)
        how |= {"noise_gain": float(np.sqrt(1 + a**2) / (1 - a))}
    if controller.is_digital:
        feedback, integrating = _response(K, read)
        whole = int(controller.delay_samples)
        own = command

        def left_by(late: int) -> FloatArray:
            delayed = own[late:] + feedback[: len(own) - late]
            return _less(delayed, i_e, K, rounding_of(own), period)

        if whole and i_ref is not None:
            place = _place(rig, rate, left_by, y, i_ref, i_c, period)
            whole, how["findings"] = place.samples, place.findings
        return left_by(whole), how, integrating
    rounding = rounding_of(i_ref if i_ref is not None else command - feedback[: len(command)])
    return _less(command, i_e, K, rounding, period), how, integrating


def _less(
    command: FloatArray, i_e: FloatArray | None, K: tuple[FloatArray, ...], rounding: FloatArray, period: int | None
) -> FloatArray:
    """What the law leaves of a command, less a known i_e and what the controller's states held at the beginning."""
    left = command if i_e is None else command - i_e[: len(command)]
    return without_free_modes(left, free_modes(K[0], K[2], len(left)), rounding, period)


def _place(
    rig: Rig,
    rate: float,
    left_by: Callable[[int], FloatArray],
    y: FloatArray,
    i_ref: FloatArray,
    i_c: FloatArray | None,
    period: int | None,
) -> CommandDelay:
    """Where a recorded command stands in the delay of the rig's controller."""
    whole = int(rig.controller.delay_samples)
    delayed = left_by(whole)
    law = by_law(left_by(0)[: len(delayed)], delayed, rounding_of(i_ref), period)
    ratio = None if i_c is None or law is False else by_current(rig, rate, i_ref, i_c, y, whole)
    return CommandDelay.of(rig.controller.delay_samples, law, ratio)


def _response(K: tuple[FloatArray, ...], y: FloatArray) -> tuple[FloatArray, bool]:
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


def _then_lag(K: tuple[FloatArray, ...], tau: float) -> tuple[FloatArray, ...]:
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


def _refuse_drift(between_steps: FloatArray, i_e: FloatArray, y: FloatArray, rig: Rig, where: str) -> None:
    """Raise where the rebuilt i_e is mostly a ramp: K integrated an offset of y that the real one did not see."""
    time = np.linspace(-0.5, 0.5, len(i_e))
    drift = np.abs(12 * (time @ between_steps) / len(i_e))
    unit = rig.amplifier.command_unit
    for axis, ramp, spread, offset in zip(rig.axes, drift, i_e.std(axis=0), y.mean(axis=0), strict=True):
        if ramp > 2 * spread:
            raise RecordError(
                f"{where}: i_e.{axis} rebuilt from y drifts by {ramp:.3g} {unit} over the record: "
                f"the mean of y.{axis}, {offset:.3g} m, is not what the integrator saw; subtract the controller's set "
                "point from y"
            )
