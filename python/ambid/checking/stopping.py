"""Which findings make records unreadable to a diagnosis; all others it judges itself, as hypotheses."""

from __future__ import annotations

from ambid.checking.excitation_slips import FOREIGN_EXCITATION
from ambid.checking.foreign import AXES_DIFFER, NO_EXCITATION, NOT_LOGGED, RATE_DIFFERS
from ambid.checking.instants import CLOCK_DIFFERENCE, SAMPLES_LOST, SAMPLES_REPEATED
from ambid.checking.ranges import ONE_PERIOD, TOO_SMALL
from ambid.findings import Finding, has

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
    FOREIGN_EXCITATION,
)


def stops_diagnosis(finding: Finding) -> bool:
    """Whether a diagnosis waits for it."""
    return has([finding], *STOPPING)
