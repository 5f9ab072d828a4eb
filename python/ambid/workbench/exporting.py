"""A session as a script, a model file and a report: what a person takes away from the page."""

from pathlib import Path
from tempfile import TemporaryDirectory

from ambid.diagnosis import diagnose
from ambid.diagnosis.ranking import Progress, silent
from ambid.errors import ModelError
from ambid.record import Measurement
from ambid.report import write_report
from ambid.rig import Rig
from ambid.workbench.session import Bench, Session

SCRIPT = '''"""What was done on the workbench, step by step, with the same numbers."""

import ambid


def report(step):
    """The misfit J/dof after a step: 1 when the model is right."""
    line = f"{{step:32s}} misfit {{comparison.misfit:.9g}}"
    if validate:  # nothing was fitted to these records
        line += f"  validation {{kept_back.cost / (kept_back.dof + len(kept_back.model.names)):.9g}}"
    print(line)


rig = {rig}
records = {records}
validate = {validate}
model = {start}

{steps}
'''


def as_python(session: Session) -> str:
    """A script of the public functions that were called; it prints the misfits that the page shows.

    Raises
    ------
    ModelError
        If the rig or a record is not from a file.
    """
    bench, rig = session.bench, session.bench.start.rig
    start = "ambid.Model(rig)" if bench.model_file is None else f"ambid.Model.load({_path(bench.model_file)}, rig)"
    return SCRIPT.format(
        rig=_rig(rig),
        records=_loaded(bench, bench.records),
        validate=_loaded(bench, bench.validate),
        start=start,
        steps="\n\n".join(f"{step.code}\nreport({step.did!r})" for step in session.chain),
    )


def as_model_file(session: Session) -> bytes:
    """The model as `Model.load` reads it; with its covariance where the step is a fit."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "model.json")
        (session.model if session.estimate is None else session.estimate).save(path)
        return path.read_bytes()


def as_report(session: Session, progress: Progress = silent) -> bytes:
    """The report of a diagnosis that adds the effects which were added here, in this order."""
    bench = session.bench
    there = {effect.name for effect in bench.start.effects}
    added = [effect for effect in session.model.effects if effect.name not in there]
    found = diagnose(bench.start, bench.records, validate=bench.validate, effects=added, progress=progress)
    with TemporaryDirectory() as folder:
        return write_report(found, Path(folder, "report.html")).read_bytes()


def _loaded(bench: Bench, records: tuple[Measurement, ...]) -> str:
    """A list of calls that read these records, each at its operating point."""
    rig, calls = bench.start.rig, []
    for record in records:
        elsewhere = None if record.point == rig else record.point
        point = "rig" if elsewhere is None else _rig(elsewhere)
        read_with = f", {bench.read_with}" if bench.read_with else ""
        call = f"ambid.load_measurement({_path(record.path)}, {point}{read_with})"
        calls.append(call if point == "rig" else f"{call}.at({point})")
    return "[{}]".format("".join(f"\n    {call}," for call in calls) + "\n" if calls else "")


def _rig(rig: Rig) -> str:
    """The call that reads a rig as it was taken here."""
    return f"ambid.Rig.load({_path(rig.path)})" + (".exact()" if rig.is_exact else "")


def _path(path: Path | None) -> str:
    if path is None:
        raise ModelError("the rig or a record was not read from a file, so that no script can read it; save it first")
    return repr(str(Path(path).absolute()))
