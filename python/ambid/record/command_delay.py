"""Whether a recorded command stands before the delay of the rig's controller or behind it: by its law, and by i_c."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ambid.arrays import FloatArray
from ambid.findings import Finding, Kind
from ambid.record.free_modes import HOLDS, REBUILT_TOLERANCE, is_held
from ambid.record.repeats import find_period
from ambid.rig import Rig

BEFORE_DELAY = Kind(
    "command_before_delay",
    "note",
    "the recorded command stands before the controller's delay: it follows what the controller reads by "
    "{late_samples} samples, delay_samples = {delay_samples:g} in the rig file[; i_c follows the command by that delay "
    "(log likelihood ratio {log_likelihood_ratio:.0f})]",
    "check delay_samples if the command was logged behind the delay: it is the delay of the sum -(K y) + i_e, from "
    "reading y to the output",
)
DELAY_NOT_SEEN = Kind(
    "controller_delay_not_seen",
    "warning",
    "delay_samples = {delay_samples:g} in the rig file, but the recorded command follows what the controller reads by "
    "{late_samples} samples, and i_c follows the command by {seen_samples} (log likelihood ratio "
    "{log_likelihood_ratio:.0f})",
    "check delay_samples: it is the delay of the sum -(K y) + i_e, from reading y to the output",
)
SURE = np.log(1000.0)
"""Log likelihood ratio that the wrong one of two commands has once in a thousand records (Royall, Statistical Evidence,
1997, 1.4); of 1301 random loops with noise, saturation and wrong lags of the amplifier two exceeded it."""
LAGS = np.geomspace(0.5, 2.0, 31)
"""Multiples of the amplifier's time constant under which i_c is held against the command."""


class CommandDelay(NamedTuple):
    """By how many samples of the controller's delay a recorded command is late, and what is to be known of it."""

    samples: int
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, delay_samples: float, by_law: bool | None, by_current: tuple[int, float] | None) -> CommandDelay:
        """Both judgements together: the law shows where the command stands, i_c whether a delay follows it."""
        whole, (seen, ratio) = int(delay_samples), by_current or (0, 0.0)
        if by_law is False or (by_law is None and ratio < SURE):
            return cls(whole)
        own: dict[str, Any] = {"delay_samples": delay_samples, "late_samples": 0}
        if ratio < -SURE:
            return cls(0, (DELAY_NOT_SEEN(**own, seen_samples=seen, log_likelihood_ratio=-ratio),))
        return cls(0, (BEFORE_DELAY(**own, log_likelihood_ratio=ratio if ratio > SURE else None),))


def by_law(at_once: FloatArray, delayed: FloatArray, rounding: FloatArray, period: int | None) -> bool | None:
    """Whether the law makes a command at once, by what it leaves of it then and where it is late; None if unclear.

    An excitation holds, as steps do, or none is left, or it repeats: the wrong delay adds what does neither.
    """
    holds = [is_held(own, rounding).mean() > HOLDS for own in (at_once, delayed)]
    if holds[0] != holds[1]:
        return bool(holds[0])
    if holds[0]:
        return None
    period = period or find_period(at_once, tolerance=REBUILT_TOLERANCE)
    period = period or find_period(delayed, tolerance=REBUILT_TOLERANCE)
    if period is None:
        return None
    left = [float(np.sum((own[period:] - own[:-period]) ** 2)) for own in (at_once, delayed)]
    if min(left) > 0.7**2 * max(left):  # the right delay leaves less of what does not repeat
        return None
    return left[0] < left[1]


def by_current(
    rig: Rig, rate: float, i_ref: FloatArray, i_c: FloatArray, y: FloatArray, whole: int
) -> tuple[int, float]:
    """Of the delays shorter than so many samples the one by which i_c follows a command most likely, and the log
    likelihood ratio of the whole delay over it.

    The amplifier's lag is simulated, and its time constant, its gain and what motion induces are free.
    """
    tau, log_left = rig.amplifier.time_constant, np.zeros(whole + 1)
    for command, current, motion in zip(i_ref.T, i_c.T, y.T, strict=True):
        for late in range(whole + 1):
            lags = (factor * tau for factor in (LAGS if tau else (1.0,)))
            left = min(_missed(command, current, motion, lag, rate, late) for lag in lags)
            log_left[late] += 0.5 * len(current) * float(np.log(max(left, 1e-300)))
    seen = int(np.argmin(log_left[:whole]))
    return seen, float(log_left[seen] - log_left[whole])


def _missed(command: FloatArray, current: FloatArray, motion: FloatArray, tau: float, rate: float, late: int) -> float:
    """Sum of squares that a lag behind a command leaves of a current."""
    from scipy.signal import lfilter  # slow to import, and seldom needed

    a = np.exp(-1.0 / (rate * tau)) if tau else 0.0
    old = np.concatenate([np.repeat(command[:1], late), command[: len(command) - late]])
    drives = [old, np.gradient(motion)]
    lagged = [lfilter([0.0, 1.0 - a], [1.0, -a], own) if tau else own for own in drives]
    table = np.column_stack([*lagged, np.ones(len(current)), a ** np.arange(len(current))])
    size = np.linalg.norm(table, axis=0)
    table = table[:, size > 0.0] / size[size > 0.0]
    found = np.linalg.lstsq(table, current, rcond=None)[0]
    return float(np.sum((current - table @ found) ** 2))
