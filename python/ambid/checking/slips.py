"""Is this rig and are these records sound, before anyone waits for a fit?

What is sought are slips of people: units, signs, columns, files that do not belong together, gains of another day.
Physics that the rig file does not know is no error; to find it is the work of a diagnosis. A gain that is off by a
factor may be either: it is found here, and ranked there beside the physics.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ambid.checking.controller_slips import GAINS_DIFFER, slips_of_controller
from ambid.checking.excitation_slips import FOREIGN_EXCITATION, slips_of_closed_loop
from ambid.checking.instants import CHANNEL_DELAY, CLOCK_DIFFERENCE, SAMPLES_LOST, SAMPLES_REPEATED, slips_of_clocks
from ambid.checking.law import Law, find_laws
from ambid.checking.law_slips import DIFFERS, slips_of_laws
from ambid.checking.lines import FEWEST_LINES, HIGHEST_FREQUENCY, Lines
from ambid.checking.machine import slips_of_machine
from ambid.checking.nominal import NominalLoop
from ambid.checking.path import path
from ambid.checking.ranges import (
    AXES_DIFFER,
    NO_EXCITATION,
    NOT_LOGGED,
    ONE_PERIOD,
    RATE_DIFFERS,
    TOO_SMALL,
    slips_of_another_rig,
    slips_of_periods,
    slips_of_ranges,
)
from ambid.checking.rig_slips import slips_of_rig
from ambid.checking.signs import opposite_sign
from ambid.checking.soundness import LoopFigures, RecordFigures, ResponseFigures, Soundness
from ambid.errors import RecordError
from ambid.findings import Finding, Kind, Where, has, worst_first
from ambid.record import Record, Source, load_measurement
from ambid.results import speed_text
from ambid.rig import Rig, as_rig
from ambid.threads import with_one_blas_thread

NO_LINES = Kind(
    "no_excited_lines",
    "warning",
    "no line of i_e between its first few and {highest_hz:g} Hz",
    "excite within the bandwidth of the loop",
)
FEW_LINES = Kind(
    "few_excited_lines",
    "warning",
    "{lines} lines of i_e: the controller is checked against the record from {fewest} on",
    "excite more lines",
)
_STOPPING = (
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
"""What makes records unreadable to a diagnosis; all else it judges itself, as hypotheses."""


@with_one_blas_thread
def check(rig: Rig | str | Path, records: Source | Sequence[Source] = ()) -> Soundness:
    """Hold a rig against itself, and records against the rig; nothing is fitted to be kept.

    Parameters
    ----------
    rig : Rig, or path of its file
    records : Record, FrequencyResponse, path of a file, or sequence of them
        Loaded with this rig, or with that of the operating point that they state. Frequency responses, and records
        without y as such, are listed with the findings of their own.

    Returns
    -------
    Soundness
        Findings, worst first, and the machine and the records in figures.
    """
    rig = as_rig(rig)
    several = (records,) if isinstance(records, Source) else tuple(records)
    given = [load_measurement(own, rig) if isinstance(own, str | Path) else own for own in several]
    loaded = [own for own in given if own.is_in_time and own.y.size]
    responses = [own.frequency_response() for own in given if not own.is_in_time or not own.y.size]
    points = dict.fromkeys(record.point for record in loaded if record.point not in (None, rig))
    loops = {own: NominalLoop(own) for own in (rig, *(point for point in points if point is not None))}
    figures = {own: LoopFigures.of(loop) for own, loop in loops.items()}
    findings, described = [], []
    laws: dict[str, tuple[Law, ...]] = {}
    for own, loop in loops.items():
        of_rig = slips_of_rig(loop, figures[own])
        findings += of_rig if own == rig else [found.at(file=str(own.path or own.name)) for found in of_rig]
    for record in loaded:
        own = rig if record.point is None else record.point
        foreign = slips_of_another_rig(record, own)
        of_record = foreign or _record(record, loops[own])
        findings += of_record
        if not foreign:
            described.append(RecordFigures.of(record, own))
            is_readable = not any(stops_diagnosis(found) or _hides(found) for found in of_record)
            if found := _laws(record, own):
                laws[record.name] = found
                findings += slips_of_laws(record.name, found) if is_readable else []
            elif is_readable:
                findings += _turned_reference(record, own)
    listed = tuple(map(ResponseFigures.of, responses))
    implementation = f"{rig.controller.implementation} {rig.controller.kind}"
    machine = (
        f"axes {', '.join(rig.axes)} at {rig.sample_rate:g} Hz, {speed_text(rig.speed)}, {implementation} controller"
    )
    findings += [own.at(record=response.name) for response in responses for own in response.findings]
    return Soundness(rig.name, machine, figures[rig], tuple(described), tuple(worst_first(findings)), laws, listed)


def _laws(record: Record, rig: Rig) -> tuple[Law, ...]:
    """The law of each axis; none where the command cannot be held against the controller."""
    try:
        return find_laws(record, rig)
    except RecordError:  # another rate, or a current that was not recorded; reported where it matters
        return ()


def _hides(finding: Finding) -> bool:
    """Whether an error leaves nothing of the machine to be checked; what is a matter of degree does not."""
    return finding.severity == "error" and not has([finding], GAINS_DIFFER, CHANNEL_DELAY)


def _responses(record: Record) -> Lines | None:
    """None of a record that is too short for them."""
    try:
        found = Lines.of_responses(record)
    except RecordError:
        return None
    return found if len(found.index) >= FEWEST_LINES else None


def _turned_reference(record: Record, rig: Rig) -> list[Finding]:
    """A reference whose sign, turned, shows the rig's law where the command follows none."""
    if record.r is None or not rig.controller.reference:
        return []
    turned = _laws(replace(record, r=-record.r), rig)
    if not turned or any(abs(law.factor - 1.0) > DIFFERS for law in turned):
        return []
    return [opposite_sign(record, "r")]


def _record(record: Record, loop: NominalLoop) -> list[Finding]:
    lines, where = Lines.of(record), Where(record=record.name)
    found = [own.at(record=record.name) for own in record.findings]
    found += [*slips_of_ranges(record, loop.rig), *path(record, loop.model), *slips_of_periods(record)]
    found += slips_of_clocks(record, loop)
    if record.is_free_response:
        return found
    if not len(lines.index):
        return [*found, NO_LINES(where, highest_hz=HIGHEST_FREQUENCY * record.sample_rate)]
    is_held = lines.i_c is not None and len(lines.index) >= FEWEST_LINES
    if lines.i_c is None:
        found += slips_of_closed_loop(record, loop, lines)
    elif is_held:
        found += slips_of_controller(record, loop, lines, None if lines.whole_periods else _responses(record))
    else:
        found.append(FEW_LINES(where, lines=len(lines.index), fewest=FEWEST_LINES))
    has_error = any(finding.severity == "error" for finding in found)
    if any(map(_hides, found)):
        return found
    return found + slips_of_machine(record, loop, lines, is_rig_right=is_held and not has_error)


def stops_diagnosis(finding: Finding) -> bool:
    """Whether a diagnosis waits for it."""
    return has([finding], *_STOPPING)
