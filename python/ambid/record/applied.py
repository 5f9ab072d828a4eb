"""A logged i_e held against the recorded command: what was really applied where the command was clipped."""

from __future__ import annotations

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import RecordError
from ambid.findings import Finding, Kind, Where
from ambid.record import checks
from ambid.record.free_modes import is_held
from ambid.record.rebuild import rounding_of, steps_of, unexplained
from ambid.rig import Rig

__all__ = ["applied_excitation"]

APPLIED = Kind(
    "excitation_as_applied",
    "note",
    "i_e is what was applied: the recorded command follows from y, the logged i_e and the rig's controller, but was "
    "clipped",
)
COMMAND_UNEXPLAINED = Kind(
    "command_unexplained",
    "warning",
    "no sum of i_e and the law of the rig's controller: {share:.2g|%} of its changes from sample to sample are left, "
    "up to {limit:g|%} expected; i_e is taken as logged",
    "see [controller], its delay, and the columns of i_e and i_ref",
)
LAWFUL = 0.99
"""Part of the samples off the limits of a command in which it must follow the law: only the limits differ then."""
ALIKE = 0.05
"""Part of the command's changes up to which the law counts as the one that made it."""


def applied_excitation(
    where: str, rig: Rig, sample_rate: float, logged: dict[str, FloatArray]
) -> tuple[FloatArray | None, list[Finding]]:
    """Hold a recorded command against y, the rig's digital controller and a logged i_e.

    Where they differ at the command's highest and lowest values alone, it was clipped, and what was applied less what
    the law asks for is the excitation. Where they differ elsewhere, i_e stays as it was logged, and a finding says so.

    Parameters
    ----------
    where : str
        For the messages.
    rig : Rig
    sample_rate : float
        [Hz].
    logged : dict
        Arrays of shape (N, axes), i_e and i_ref among them.

    Returns
    -------
    i_e : ndarray, shape (N, axes), or None
        As applied; None where it stays as it was logged.
    findings : list of Finding
    """
    signals = {name: logged.get(name) for name in ("i_ref", "i_c", "r", "i_e")}
    i_e, i_ref = logged["i_e"], logged["i_ref"]
    if not rig.controller.is_digital:  # between the samples it follows y, which nobody recorded
        return None, []
    try:
        left = unexplained(rig, sample_rate, y=logged["y"], **signals, where=where)
    except RecordError:  # another rate, or a current that was not recorded
        return None, []
    late = len(i_ref) - len(left)
    command, rounding = i_ref[late:], rounding_of(i_ref)
    free = ~np.column_stack([checks.at_limits(own) for own in command.T])
    free[1:] &= free[:-1]
    held = is_held(left, rounding)
    if held.all():
        return None, []
    steps = steps_of(left, rounding) if held[free].mean() > LAWFUL else None
    if steps is not None and checks.findings_of_limits(rig.axes, i_ref):
        applied = i_e.copy()
        applied[: len(left)] += steps - np.median(steps, axis=0)
        return applied, [APPLIED()]
    changes = np.abs(np.where(free, np.diff(left, axis=0, prepend=left[:1]), 0.0))
    size = np.diff(command, axis=0).std(axis=0)
    missed = np.sqrt(np.mean(changes**2, axis=0)) / np.maximum(size, 1e-300)
    return None, [
        COMMAND_UNEXPLAINED(Where(channel=f"i_ref.{axis}"), share=float(part), limit=ALIKE)
        for axis, part in zip(rig.axes, missed, strict=True)
        if part > ALIKE
    ]
