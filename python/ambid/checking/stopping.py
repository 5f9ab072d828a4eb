"""Which findings make a diagnosis not worth its time before they are settled."""

from __future__ import annotations

from ambid.checking.controller_slips import CHANNELS_EXCHANGED, CURRENT_WITHOUT_EXCITATION, GAINS_BEYOND_RANGE
from ambid.checking.excitation_slips import EXCITATION_ORDER, EXCITATION_SHIFTED, FOREIGN_EXCITATION
from ambid.checking.foreign import AXES_DIFFER, NO_EXCITATION, NOT_LOGGED, RATE_DIFFERS
from ambid.checking.instants import CLOCK_DIFFERENCE, SAMPLES_LOST, SAMPLES_REPEATED
from ambid.checking.machine import OTHER_MACHINE
from ambid.checking.ranges import ONE_PERIOD, TOO_SMALL
from ambid.checking.scales import WRONG_UNIT
from ambid.checking.signs import OPPOSITE_SIGN
from ambid.findings import Finding, has

__all__ = ["STOPPING", "stops_diagnosis"]

STOPPING = (
    AXES_DIFFER,
    RATE_DIFFERS,
    NOT_LOGGED,
    NO_EXCITATION,
    TOO_SMALL,
    ONE_PERIOD,
    CLOCK_DIFFERENCE,
    SAMPLES_LOST,
    SAMPLES_REPEATED,
    CHANNELS_EXCHANGED,
    EXCITATION_ORDER,
    EXCITATION_SHIFTED,
    FOREIGN_EXCITATION,
    OPPOSITE_SIGN,
    WRONG_UNIT,
    CURRENT_WITHOUT_EXCITATION,
    GAINS_BEYOND_RANGE,
    OTHER_MACHINE,
)


def stops_diagnosis(finding: Finding) -> bool:
    """Whether a diagnosis waits for it."""
    return has([finding], *STOPPING)
