"""Commands that hold rig, model and records against each other: `check`, `compare`, `rank`, `diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import ambid
from ambid.cli.files import load_model, load_records, load_rig, naming_unstable, require_first_point
from ambid.cli.options import (
    Allow,
    Before,
    Columns,
    Exact,
    JsonFile,
    ModelFile,
    Period,
    PlotFile,
    Quiet,
    RecordFiles,
    RigFile,
    SampleRate,
    SaveRig,
    Validation,
    known_effects,
    names,
    span,
)
from ambid.cli.outputs import (
    Files,
    command_of,
    conclude,
    drawn,
    pictures,
    reported,
    require_outputs,
    saved,
    with_command,
)
from ambid.cli.signals import came, done_of, droppable, exit_code, stoppable, stopped
from ambid.cli.terminal import choose, progress, require_terminal, say, with_time_left
from ambid.cli.updating import files_of_mended, mended, require_rig, updated
from ambid.errors import InputError, RecordError
from ambid.results import band_text

if TYPE_CHECKING:
    from ambid.diagnosis.localisation import Cell


def check_command(
    rig: RigFile,
    records: Annotated[
        list[Path], typer.Argument(metavar="[RECORD...]", help="Records and frequency responses of this rig.")
    ] = [],  # noqa: B006
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Check rig and records for mistakes, such as units, signs and columns, before any fit; exit 2 for an error."""
    require_outputs({"RIG": rig, "RECORD": records}, {"--json": json_file})
    machine = load_rig(rig, exact)
    loaded = load_records(machine, records, period, columns, sample_rate, allow)
    with stoppable():
        found = ambid.check(machine, loaded)
    conclude(found, found.to_json(), json_file, quiet)
    if not found.is_sound and quiet:
        raise InputError(f"{rig}: {len(found.errors)} error(s), first {found.errors[0].line()}")
    if not found.is_sound:
        raise typer.Exit(2)


def compare_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
    before: Before = None,
    stretch: Annotated[
        str | None, typer.Option(metavar="FROM:TO", help="What to draw [s]; default: where the model misses most.")
    ] = None,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Show where and by how much the model misses the measurement; nothing is fitted."""
    outputs = {"--json": json_file, "--plot": pictures(plot, records)}
    for option, value in (("--before", before), ("--stretch", stretch)):
        if value is not None and plot is None:
            raise InputError(f"{option} {value}: says what is drawn, and nothing is; add --plot FILE, or leave it out")
    shown = None if stretch is None else span("--stretch", stretch, "FROM:TO", "0.5:0.56")
    start, loaded = _opened(rig, exact, records, model, period, columns, sample_rate, allow, outputs, before)
    earlier = None if before is None else load_model(start.rig, before).covering(loaded)
    with stoppable(), naming_unstable(rig, start, model):
        comparison = ambid.compare(start, loaded)
        where, matrices = _where(comparison), ambid.misfit_matrix(comparison) if comparison.is_judged else ()
    largest = ["", "largest misfit:", *map(_line, where[:5])] if where else []
    data = comparison.to_json() | {
        "where": [asdict(cell) for cell in where],
        "matrix": [own.to_json() for own in matrices],
    }
    found = [line for own in comparison.records for line in own.finding_lines()]
    text = "\n".join([str(comparison), *largest, *found])
    conclude(
        text,
        data,
        json_file,
        quiet,
        lambda: () if plot is None else ambid.plot.save_comparison(comparison, plot, stretch=shown, before=earlier),
    )


def rank_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
    predict: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Tell what this effect would leave, by channel and band; --plot draws that.",
            autocompletion=known_effects,
        ),
    ] = None,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw the ranking.")] = None,
    quiet: Quiet = False,
) -> None:
    """Score every effect that the model lacks by what adding it would bring; only the model itself is fitted."""
    from ambid.record.measurement import findings_of_repeats  # not at the top: --help need not open that room

    ambid.plot.check_format(plot)
    if predict is not None:
        ambid.effects.find(predict)  # refuses a name that is none
    outputs = {"--json": json_file, "--plot": plot}
    require_first_point(rig, records)
    start, loaded = _opened(rig, exact, records, model, period, columns, sample_rate, allow, outputs)
    with stoppable(), naming_unstable(rig, start, model), progress(quiet, "ranking") as bar:
        comparison = ambid.identify(start, loaded).comparison
        ranking = ambid.rank(comparison, progress=with_time_left(bar))
        expected = None if predict is None else ambid.predict(ranking, predict)
    twice = findings_of_repeats([own.record for own in comparison.records])
    text, data = (
        [str(ranking), *(f"{own.severity}: {own.line()}" for own in twice)],
        {"notes": [], **ranking.to_json()},
    )
    if expected is not None:
        text, data = [*text, "", *expected.lines()], data | {"prediction": expected.to_json()}

    def drawing() -> Sequence[Path]:
        if plot is None:
            return ()
        return [
            ambid.plot.save_ranking(ranking, plot) if expected is None else ambid.plot.save_prediction(expected, plot)
        ]

    conclude("\n".join(text), data, json_file, quiet, drawing, findings=twice)


def priors(given: Sequence[str]) -> dict[str, float]:
    """Probabilities of effects before any record, as ``--prior`` takes them.

    Raises
    ------
    InputError
        For an unknown effect, or what is no probability.
    """
    found = {}
    for own in given:
        name, _, text = own.partition("=")
        ambid.effects.find(name)  # refuses a name that is none
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not 0.0 < value < 1.0:
            raise InputError(f"--prior {own}: expected NAME=P with a probability P between 0 and 1, such as {name}=0.5")
        found[name] = value
    return found


def diagnose_command(
    rig: RigFile,
    records: RecordFiles,
    validate: Validation = [],  # noqa: B006
    effects: Annotated[
        str | None,
        typer.Option(metavar="NAME,...", help="Add these instead of choosing.", autocompletion=known_effects),
    ] = None,
    ask: Annotated[bool, typer.Option("--ask", help="Show the ranking and ask before an effect is added.")] = False,
    tolerance: Annotated[float | None, typer.Option(help="Misfit J/dof that is good enough.")] = None,
    prior: Annotated[
        list[str],
        typer.Option(metavar="NAME=P", help="Probability of an effect before any record, such as unbalance=0.5."),
    ] = [],  # noqa: B006
    model: ModelFile = None,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
    exact: Exact = False,
    json_file: JsonFile = None,
    save: Annotated[Path | None, typer.Option(metavar="MODEL", help="Write the last model.")] = None,
    save_rig: SaveRig = None,
    mend: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Write the records without the errors of theirs that are named."),
    ] = None,
    plot: PlotFile = None,
    report: Annotated[Path | None, typer.Option(metavar="FILE.html", help="Write a report to read and print.")] = None,
    pdf: Annotated[
        Path | None, typer.Option("--pdf", metavar="FILE.pdf", help="Write the report on A4; needs ambid[pdf].")
    ] = None,
    following: Annotated[
        bool, typer.Option("--next", help="Where the verdict is ambiguous, foresee which experiment would settle it.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Name the physics that the model lacks, add it, and watch the misfit fall."""
    mended_files = files_of_mended(mend, records)
    require_outputs(
        {"RIG": rig, "RECORD": records, "--validate": validate, "--model": model},
        {
            "--json": json_file,
            "--save": save,
            "--save-rig": save_rig,
            "--mend": mended_files,
            "--plot": pictures(plot, records),
            "--report": report,
            "--pdf": pdf,
        },
    )
    for option, path, suffixes in (("--report", report, (".html", ".htm")), ("--pdf", pdf, (".pdf",))):
        if path is None:
            continue
        if path.suffix.lower() not in suffixes:
            raise InputError(f"{option} {path}: the suffix is {path.suffix or 'missing'}; expected {suffixes[0]}")
        ambid.report.check_suffix(path)
    reports = [path for path in (report, pdf) if path is not None]
    if tolerance is not None and not tolerance >= 1.0:
        raise InputError(f"--tolerance {tolerance:g}: expected 1, the misfit of noise alone, or more")
    chosen = None if effects is None else [ambid.effects.find(name) for name in names("--effects", effects) or ()]
    expected = priors(prior)
    if ask:
        if quiet or chosen is not None:
            raise InputError(f"--ask and {'--quiet' if quiet else '--effects'} exclude each other; keep one")
        require_terminal("--ask")
    require_first_point(rig, records)
    machine = load_rig(rig, exact)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate, allow)
    require_rig(save_rig, start)
    kept = load_records(machine, validate, period, columns, sample_rate, allow)
    with stoppable(), progress(quiet or ask, "diagnosing") as bar:
        diagnosing = partial(
            ambid.diagnose,
            start,
            loaded,
            validate=kept,
            effects=chosen,
            tolerance=tolerance,
            prior=expected,
            ask=choose if ask else None,
            say=lambda line: say(line, quiet),
            progress=with_time_left(bar),
        )
        found, is_stopped = done_of(diagnosing, ambid.Diagnosis)
        text, further = "", dict[str, Any]()
        if following and found.verdict == "ambiguous" and not is_stopped:
            with droppable():
                text, further = _with_next(found)
            if is_stopped := came():
                text, further = f"\n{stopped()} when the diagnosis was finished; no experiment was foreseen", {}
    command = command_of(found.next_steps)
    update, mends = updated(found, save_rig), mended(found, mended_files)
    own = {"next_command": command} | further | update.data | mends.data | {"stopped": is_stopped}
    conclude(
        f"{with_command(str(found), command)}{text}{update.text}{mends.text}",
        lambda: found.to_json() | own,
        json_file,
        quiet,
        lambda: saved(found, save),
        update.write,
        mends.write,
        lambda: drawn(found.model, loaded, plot),
        lambda: reported(found, reports),
        findings=(*update.findings, *mends.findings),
        is_stopped=is_stopped,
    )
    if is_stopped:
        raise typer.Exit(exit_code())


def _with_next(found: ambid.Diagnosis) -> tuple[str, dict[str, Any]]:
    """What is reported beside an ambiguous diagnosis: the experiments that would settle it."""
    try:
        proposals = ambid.next_experiments(found)
    except (InputError, RecordError) as error:  # no periods or no i_e: the diagnosis stands
        return f"\nno experiment is foreseen: {error}", {"next_experiments": None}
    return f"\n\n{proposals}", {"next_experiments": proposals.to_json()}


def _opened(
    rig: Path,
    exact: bool,
    records: list[Path],
    model: Path | None,
    period: int | None,
    columns: list[str],
    sample_rate: float | None,
    allow: list[str],
    outputs: Files,
    before: Path | None = None,
) -> tuple[ambid.Model, list[ambid.Record | ambid.FrequencyResponse]]:
    """Model and records of a command, once it is known that its outputs can be written."""
    require_outputs({"RIG": rig, "RECORD": records, "--model": model, "--before": before}, outputs)
    machine = load_rig(rig, exact)
    return load_model(machine, model), load_records(machine, records, period, columns, sample_rate, allow)


def _where(comparison: ambid.Comparison) -> Sequence[Cell]:
    """Cells with the largest misfit, if the noise is known."""
    with suppress(RecordError):  # too short, or no noise
        return ambid.localise(comparison).cells[:20]
    return ()


def _line(cell: Cell) -> str:
    low, high = cell.band_hz
    place = f"  {cell.record}: {cell.channel:12s} {band_text(low, high):>14s} Hz"
    return f"{place}: {cell.misfit:.1f} times noise, {cell.kind}"
