"""The law that a recorded command follows against the rig's controller: where another explains it far better."""

from collections.abc import Sequence
from typing import Any

from ambid.checking.law import Law
from ambid.findings import Finding, Kind, Severity, Where

FAR_BETTER = 0.1
"""Part of what the rig's controller leaves to which a law must bring it to be held against it."""
MATTERS = 1e-3
"""Part of the command, from sample to sample, that the rig's controller must leave: less is a matter of digits."""
NEARLY = 0.01
"""Part of what the rig's controller leaves that may be left by a factor on all of it, beside what a law leaves."""
DIFFERS = 0.02
"""Relative difference of a gain from the rig's that is reported, beyond five standard errors."""
KEYS = {
    "e": "proportional",
    "int e": "integral",
    "de/dt": "derivative",
    "lag": "derivative_time_constant",
}

_MISSED = "the rig's controller misses {missed:.2g} of the recorded command, "
COMMAND_SCALE = Kind(
    "command_scale",
    "error",
    _MISSED + "{factor:.4g} times its gains miss {missed_scaled:.1g}",
    "check the unit and the scale of i_ref (with a factor of {mapping_factor:.4g} on it, it is as the rig says); or "
    "all gains in [controller] are off by this factor",
)
COMMAND_SIGN = Kind(
    "command_sign",
    "error",
    COMMAND_SCALE.message,
    "the sign of i_ref, or those of both y and r, are opposite: map them with a factor -1",
)
LAW_DIFFERS = Kind(
    "control_law_differs",
    "error",
    _MISSED + "the law identified from it {missed_by_law:.1g}, with {gains:.4g} (in the rig {rig_gains:.4g})",
    "correct [controller], or take the rig file of that day; a diagnosis ranks a wrong gain beside the physics",
)
OTHER_LAW = Kind(
    "other_control_law",
    "error",
    _MISSED + "the law identified from it {missed_by_law:.1g}: it is not the rig's",
    "check that [controller] is the one that ran; the law that was identified is in the line of the record",
)


def slips_of_laws(record: str, laws: Sequence[Law]) -> list[Finding]:
    """By which factor all gains of the rig's controller differ from the law that was recorded, or which gain does.

    No finding stops a diagnosis, which ranks a wrong gain beside the physics.
    """
    return [found for law in laws if (found := _slip(record, law)) is not None]


def _slip(record: str, law: Law) -> Finding | None:
    if law.left > FAR_BETTER * law.rig_left or law.rig_left < MATTERS:
        return None
    values: dict[str, Any] = {"missed": law.rig_left}
    if law.factor_left < 3.0 * law.left + NEARLY * min(law.rig_left, 1.0):
        kind, off = COMMAND_SIGN if law.factor < 0.0 else COMMAND_SCALE, abs(law.factor - 1.0)
        values |= {
            "factor": law.factor,
            "missed_scaled": law.factor_left,
            "mapping_factor": 1.0 / law.factor,
        }
    elif law.rig_gains:
        gains = {name: (own, law.rig_gains.get(name, 0.0)) for name, own in law.gains.items()}
        errors = {name: law.std_error.get(name, 0.0) for name in gains}
        differ = {KEYS.get(name, name): own for name, own in gains.items() if _differs(*own, errors[name])}
        kind, off = LAW_DIFFERS, max((abs(own - of) / max(abs(of), 1e-300) for own, of in differ.values()), default=0.0)
        values |= {
            "missed_by_law": law.left,
            "gains": {name: own for name, (own, _) in differ.items()},
            "rig_gains": {name: of for name, (_, of) in differ.items()},
        }
    else:
        kind, off = OTHER_LAW, law.rig_left
        values["missed_by_law"] = law.left
    if off < DIFFERS:
        return None
    severity: Severity = "error" if off > 0.1 else "warning"
    return kind(Where(record=record, channel=f"i_ref.{law.axis}"), severity=severity, **values)


def _differs(own: float, of_rig: float, error: float) -> bool:
    return abs(own - of_rig) > DIFFERS * max(abs(own), abs(of_rig)) + 5.0 * error
