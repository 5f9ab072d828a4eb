"""The law that a recorded command follows against the rig's controller: where another explains it far better."""

from __future__ import annotations

from collections.abc import Sequence

from ambid.checking.law import Law
from ambid.checking.soundness import Finding

__all__ = ["slips_of_laws"]

FAR_BETTER = 0.1
"""Part of what the rig's controller leaves to which a law must bring it to be held against it."""
MATTERS = 1e-3
"""Part of the command, from sample to sample, that the rig's controller must leave: less is a matter of digits."""
NEARLY = 0.01
"""Part of what the rig's controller leaves that may be left by a factor on all of it, beside what a law leaves."""
DIFFERS = 0.02
"""Relative difference of a gain from the rig's that is told, beyond five standard errors."""
WRONG = 0.10
"""Relative difference from which on it is a fault."""
KEYS = {
    "e": "proportional",
    "int e": "integral",
    "de/dt": "derivative",
    "lag": "derivative_time_constant",
}


def slips_of_laws(record: str, laws: Sequence[Law]) -> list[Finding]:
    """By which factor all gains of the rig's controller differ from the law that was recorded, or which gain does.

    No finding stops a diagnosis, which ranks a wrong gain beside the physics.
    """
    return [found for law in laws if (found := _slip(record, law)) is not None]


def _slip(record: str, law: Law) -> Finding | None:
    if law.left > FAR_BETTER * law.rig_left or law.rig_left < MATTERS:
        return None
    what = f"the rig's controller leaves {law.rig_left:.2g} of the recorded command, "
    if law.factor_left < 3.0 * law.left + NEARLY * min(law.rig_left, 1.0):
        off = abs(law.factor - 1.0)
        what += f"{law.factor:.4g} times its gains leave {law.factor_left:.1g}"
        todo = f"check the unit and the scale of i_ref (mapped with a factor {1.0 / law.factor:.4g} it is as the rig "
        todo += "says); or all gains in [controller] are off by this factor"
        if law.factor < 0.0:
            todo = "the sign of i_ref, or those of both y and r, are opposite: map them with a factor -1"
    elif law.rig_gains:
        gains = {name: (own, law.rig_gains.get(name, 0.0)) for name, own in law.gains.items()}
        errors = {name: law.std_error.get(name, 0.0) for name in gains}
        differ = {name: own for name, own in gains.items() if _differs(*own, errors[name])}
        off = max((abs(own - of) / max(abs(of), 1e-300) for own, of in differ.values()), default=0.0)
        told = ", ".join(
            f"{KEYS.get(name, name)} {own:.4g} (in the rig {of:.4g})" for name, (own, of) in differ.items()
        )
        what += f"the law found from it {law.left:.1g}, with {told}"
        todo = (
            "correct [controller], or take the rig file of that day; a diagnosis ranks a wrong gain beside the physics"
        )
    else:
        off = law.rig_left
        what += f"the law found from it {law.left:.1g}: it is another than the rig's"
        todo = "see that [controller] is the one that ran; the law that was found is in the line of the record"
    if off < DIFFERS:
        return None
    return Finding("fault" if off > WRONG else "warning", f"{record}: i_ref.{law.axis}", what, todo)


def _differs(own: float, of_rig: float, error: float) -> bool:
    return abs(own - of_rig) > DIFFERS * max(abs(own), abs(of_rig)) + 5.0 * error
