"""Commands that find parameters: `identify`, `static-load`, `campaign`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

import ambid
from ambid.cli.files import load_model, load_records, load_rig, naming_unstable, require_first_point
from ambid.cli.options import (
    Allow,
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
    assignment,
    bound,
    names,
    number,
)
from ambid.cli.outputs import command_of, conclude, drawn, pictures, require_outputs, saved, with_command
from ambid.cli.signals import done_of, exit_code, stoppable
from ambid.cli.terminal import progress
from ambid.cli.updating import require_rig, updated
from ambid.errors import IdentificationError, InputError, ModelError, UnstableLoopError
from ambid.findings import Finding, has
from ambid.results import of_unit

UNFINISHED = ("not_identifiable", "max_evaluations")
MEND = (
    "first: correct the error and fit again; until then neither the values nor what seems to be missing means anything"
)

Deflection = Annotated[bool, typer.Option("--deflection", help="Take in K_s s of the bent rotor.")]


def identify_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    free: Annotated[str | None, typer.Option(metavar="NAME,...", help="Parameters to fit, such as K_i,tau_e.")] = None,
    fix: Annotated[list[str], typer.Option(metavar="NAME[=VALUE]", help="Keep at the start value, or at VALUE.")] = [],  # noqa: B006
    share: Annotated[list[str], typer.Option(metavar="NAME=MEMBER,...", help="One parameter for several axes.")] = [],  # noqa: B006
    per_axis: Annotated[list[str], typer.Option(metavar="NAME", help="One value per axis, such as tau_e.")] = [],  # noqa: B006
    limits: Annotated[list[str], typer.Option("--bound", metavar="NAME=LOW:HIGH", help="Bounds in SI units.")] = [],  # noqa: B006
    weight: Annotated[list[str], typer.Option(metavar="eq9|CHANNEL=W", help="eq9, or factors on it.")] = [],  # noqa: B006
    starts: Annotated[int, typer.Option(help="Number of starts.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the further starts.")] = 0,
    max_evaluations: Annotated[int, typer.Option(help="Per start.")] = 100,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
    exact: Exact = False,
    json_file: JsonFile = None,
    save: Annotated[Path | None, typer.Option(metavar="MODEL", help="Write the identified model.")] = None,
    save_rig: SaveRig = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Find K_i, K_s and tau_e by closed-loop identification."""
    outputs = {"--json": json_file, "--save": save, "--save-rig": save_rig, "--plot": pictures(plot, records)}
    require_outputs({"RIG": rig, "RECORD": records, "--model": model}, outputs)
    require_first_point(rig, records)
    machine = load_rig(rig, exact)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate, allow)
    for text in share:
        name, members = assignment("--share", text, "K_i.A=K_i.A_zeta,K_i.A_eta")
        start = start.share(name, members.split(","))
    for name in per_axis:
        start = start.per_axis(name)
    require_rig(save_rig, start)
    if save_rig is not None and _weights(weight) != "likelihood":
        raise InputError(
            f"--save-rig {save_rig}: the weights of eq. 9 estimate no errors of the rig file; leave --weight out"
        )
    free_start, start = start, _held(start, fix)
    with stoppable(), progress(quiet, "identifying") as report:
        identified = partial(
            ambid.identify,
            start,
            loaded,
            free=names("--free", free),
            fixed=[text.split("=")[0] for text in fix],
            bounds=dict(bound(text) for text in limits) or None,
            weights=_weights(weight),
            starts=starts,
            seed=seed,
            max_evaluations=max_evaluations,
            progress=lambda evaluations, cost: report(f"evaluation {evaluations}, cost {cost:.6g}"),
        )
        try:
            with naming_unstable(rig, start, model):
                estimate, _ = done_of(identified, ambid.Estimate)
        except UnstableLoopError as error:
            if start.theta.tolist() == free_start.theta.tolist() or not free_start.is_stable:
                raise
            held = " ".join(f"--fix {text}" for text in fix if "=" in text)
            raise InputError(
                f"{held}: the closed loop is unstable with what is fixed, and stable at {_left_by(free_start, start)}, "
                "where the rig file or the model has it; correct the value, in SI units"
            ) from error
    slips = _slips(machine, [own for own in loaded if own.is_in_time], estimate)
    lines = [f"{slip.severity}: {slip.line(advises=not estimate.is_adequate)}" for slip in slips]
    command = command_of([estimate.next_step])
    update = updated(estimate, save_rig)
    first = [MEND] if any(slip.severity == "error" for slip in slips) else []
    text = "\n".join([with_command(str(estimate), command), *(f"check: {line}" for line in lines), *first])
    conclude(
        f"{text}{update.text}",
        {**estimate.to_json(), "next_command": command, "check": lines, **update.data},
        json_file,
        quiet,
        lambda: saved(estimate, save),
        update.write,
        lambda: drawn(estimate.model, loaded, plot),
        findings=(*slips, *update.findings),
        is_stopped=estimate.status == "stopped",
    )
    if estimate.status == "stopped":
        raise typer.Exit(exit_code())
    if estimate.status in UNFINISHED and quiet:
        raise IdentificationError(f"{estimate.status}: {estimate.to_json()['status_meaning']}")
    if estimate.status in UNFINISHED:
        raise typer.Exit(1)


def _held(start: ambid.Model, fix: list[str]) -> ambid.Model:
    """The start with the values of ``--fix NAME=VALUE``; a name may be a pattern."""
    for text in fix:
        if "=" not in text:
            continue
        name, value = assignment("--fix", text, "tau_e=0.0003")
        try:
            start = start.with_values({start.names[i]: number("--fix", value) for i in start.index([name])})
        except ModelError as error:
            raise ModelError(f"--fix {text}: {error}") from None
    return start


def _left_by(before: ambid.Model, after: ambid.Model) -> str:
    """The values that another model has not kept."""
    pairs = zip(before.parameters, after.parameters, strict=True)
    return ", ".join(f"{own.name} = {own.value:g}{of_unit(own.unit)}" for own, new in pairs if own.value != new.value)


def _slips(machine: ambid.Rig, loaded: list[ambid.Record], estimate: ambid.Estimate) -> list[Finding]:
    """What `check` finds where the misfit is above its bound: dirt on a record looks like missing physics.

    Operating points that a record passes through are reported in any case: they hide what is missing.
    """
    from ambid.checking import OPERATING_POINT_DRIFT  # not at the top: --help need not open that room

    known = {(own.code, own.message) for own in estimate.findings}
    findings = ambid.check(machine, loaded).findings
    is_whole = not estimate.is_adequate and estimate.comparison.is_judged
    if not is_whole:
        findings = tuple(found for found in findings if has([found], OPERATING_POINT_DRIFT))
    return [found for found in findings if found.severity != "note" and (found.code, found.message) not in known]


def _weights(texts: list[str]) -> str | dict[str, float]:
    """``likelihood``, ``eq9``, or eq. 9 with factors by channel."""
    if len(texts) == 1 and "=" not in texts[0]:
        return texts[0]
    factors = {n: number("--weight", v) for n, v in (assignment("--weight", t, "i_c=0") for t in texts)}
    return factors or "likelihood"


def static_load_command(
    rig: RigFile,
    loads: Annotated[list[Path], typer.Argument(metavar="LOADS...", help="Static loadings (.csv).")],
    deflection: Deflection = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Find K_i by static loading: equilibrium of known forces and recorded currents."""
    require_outputs({"RIG": rig, "LOADS": loads}, {"--json": json_file})
    machine = load_rig(rig, exact)
    loaded = [ambid.StaticLoading.load(path, machine) for path in loads]
    with stoppable():
        estimate = ambid.static_load(machine, loaded, deflection=deflection)
    command = command_of(estimate.findings)
    conclude(with_command(str(estimate), command), {**estimate.to_json(), "next_command": command}, json_file, quiet)


def campaign_command(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", help="One folder per bias current: rig.toml, <kind>_<N>.mat, static_<N>.csv."),
    ],
    deflection: Deflection = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw K_i, K_s and tau_e against bias current, a file each.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the tables, a file each (.csv, .tex).")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Find K_i by both methods, K_s and tau_e at every bias current of a campaign."""
    from ambid.campaigns.tables import is_table, table_files  # not at the top: --help need not open that room

    tables = [] if table is None else table_files(table)
    plots = [] if plot is None else ambid.plot.campaign_files(plot)
    outputs = {"--json": json_file, "--plot": plots, "--table": tables}
    require_outputs({}, outputs, replaced=[path for path in tables if path.is_file() and is_table(path)])
    with stoppable(), progress(quiet, "campaign") as report:
        measuring = partial(
            ambid.campaign,
            folder,
            deflection=deflection,
            exact=exact,
            progress=lambda done, total, where: report(f"{done} of {total} done, now {where}"),
        )
        found, is_stopped = done_of(measuring, ambid.Campaign)
    command = command_of([found.next_step])
    conclude(
        with_command(str(found), command),
        {**found.to_json(), "next_command": command},
        json_file,
        quiet,
        lambda: () if plot is None else ambid.plot.save_campaign(found, plot),
        lambda: () if table is None else found.save_tables(table),
        is_stopped=is_stopped,
    )
    if is_stopped:
        raise typer.Exit(exit_code())
