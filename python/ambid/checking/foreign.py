"""Is a record of this rig at all: has it the rig's axes and rate, and an excitation?"""

from __future__ import annotations

from ambid.findings import Finding, Kind, Where
from ambid.record import Record
from ambid.record.checks import decays
from ambid.rig import Rig

AXES_DIFFER = Kind(
    "axes_differ", "error", "axes {axes}, the rig has {rig_axes}", "load the record with the rig that it belongs to"
)
RATE_DIFFERS = Kind(
    "sample_rate_differs",
    "error",
    "{sample_rate_hz:g} Hz, the rig samples at {rig_sample_rate_hz:g} Hz",
    AXES_DIFFER.remedy,
)
NOT_LOGGED = Kind(
    "excitation_not_logged", "error", "i_e was not logged", "load the record with its rig, whose controller rebuilds it"
)
NO_EXCITATION = Kind("no_excitation", "error", "no excitation: {signals} constant on every axis", "excite the loop")


def slips_of_another_rig(record: Record, rig: Rig) -> list[Finding]:
    """What keeps all else from being checked."""
    where = Where(record=record.name)
    if record.axes != rig.axes:
        return [AXES_DIFFER(where, axes=list(record.axes), rig_axes=list(rig.axes))]
    if abs(record.sample_rate / rig.sample_rate - 1.0) > 1e-6:
        return [RATE_DIFFERS(where, sample_rate_hz=record.sample_rate, rig_sample_rate_hz=rig.sample_rate)]
    if record.i_e is None:
        return [NOT_LOGGED(where)]
    if record.is_free_response and not decays(record.y):
        return [NO_EXCITATION(where, signals=["i_e"] if record.r is None else ["i_e", "r"])]
    return []
