"""Commands on how the loop responds and stands: `frequency-response`, `margins`, `poles`, `campbell`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, cast

import numpy as np
import typer

import ambid
from ambid.cli.files import count_of, load_model, load_records, load_rig
from ambid.cli.options import (
    Before,
    Columns,
    Exact,
    Force,
    JsonFile,
    ModelFile,
    Period,
    PlotFile,
    Quiet,
    RecordFiles,
    RigFile,
    SampleRate,
    span,
)
from ambid.cli.outputs import Files, conclude, pictures, require_new, require_outputs
from ambid.cli.signals import stoppable
from ambid.cli.terminal import progress, with_time_left
from ambid.errors import InputError

Uncertain = Annotated[
    Path | None, typer.Option("--model", metavar="MODEL", help="Of what --save wrote, with its uncertainty.")
]


def frequency_response_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    before: Before = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the measured responses (.csv, .mat); several get numbered names."),
    ] = None,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    force: Force = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Make frequency responses of records, with their uncertainty, and hold the model's against them.

    Tells which excitation the model answers wrongly at which output, band by band, with the sign of the real part.
    """
    from ambid.record.writers import require_response_format  # not at the top: --help need not open that room

    written = [] if out is None else ambid.plot.picture_files(out, count_of(records))
    for path in written:
        require_response_format(path)
        require_new("--out", path, force)
    drawn = pictures(plot, records)
    outputs = {"--out": written, "--json": json_file, "--plot": drawn}
    inputs: Files = {"RIG": rig, "RECORD": records, "--model": model, "--before": before}
    require_outputs(inputs, outputs, replaced=["--out"])
    machine = load_rig(rig, exact)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate)
    with stoppable():
        measured = [own.frequency_response() for own in loaded]
        comparison = ambid.compare(start, measured)
        in_signals = ambid.compare(start, loaded)
        others = [] if before is None else [load_model(machine, before).covering(loaded)]
        responses = [ambid.frequency_responses(in_signals, k, others) for k in range(len(loaded))]
        matrices = ambid.misfit_matrix(in_signals) if in_signals.is_judged else ()
    by_excitation = [line for own in matrices for line in (f"{own.record}, by excitation:", *_indented(own.lines()))]

    def saved() -> Sequence[Path]:
        for own, path in zip(measured, written, strict=bool(written)):
            own.save(path)
        return written

    found = [line for own in measured for line in own.finding_lines()]
    conclude(
        "\n".join([*map(str, measured), "", str(comparison), *by_excitation, *found]),
        lambda: {
            "responses": [own.to_json() for own in responses],
            "matrix": [own.to_json() for own in matrices],
            **comparison.to_json(),
        },
        json_file,
        quiet,
        saved,
        lambda: [ambid.plot.save_responses(own, path) for own, path in zip(responses, drawn, strict=bool(drawn))],
    )


def _indented(lines: Sequence[str]) -> list[str]:
    return [f"  {line}" for line in lines] or ["  nothing beyond chance"]


def margins_command(
    rig: RigFile,
    model: Uncertain = None,
    at: Annotated[str, typer.Option(metavar="controller|sensor", help="Where the loop is broken.")] = "controller",
    draws: Annotated[int | None, typer.Option(help="Of the parameters; default: 500.")] = None,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the sensitivity over frequency.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Tell peaks of the sensitivity, their zones after ISO 14839-3 with probabilities, and disk margins."""
    from ambid.robustness.procedure import DRAWS  # not at the top: --help need not open that room

    ambid.plot.check_format(plot)
    require_outputs({"RIG": rig, "--model": model}, {"--json": json_file, "--plot": plot})
    start = load_model(load_rig(rig, exact), model)
    with stoppable(), progress(quiet, "margins") as bar:
        show = with_time_left(bar)
        found = ambid.margins(
            start,
            at=cast(Literal["controller", "sensor"], at),
            draws=DRAWS if draws is None else draws,
            seed=seed,
            progress=lambda done, total: show("draws", done, total),
        )
    conclude(
        found,
        found.to_json(),
        json_file,
        quiet,
        lambda: () if plot is None else [ambid.plot.save_sensitivity(found, plot)],
    )


def poles_command(
    rig: RigFile,
    model: Uncertain = None,
    before: Before = None,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw the map of the poles.")] = None,
    quiet: Quiet = False,
) -> None:
    """Tell the poles of the closed loop with their uncertainty, and those of the plant alone."""
    ambid.plot.check_format(plot)
    require_outputs({"RIG": rig, "--model": model, "--before": before}, {"--json": json_file, "--plot": plot})
    machine = load_rig(rig, exact)
    start = load_model(machine, model)
    with stoppable():
        found = ambid.pole_map(start)
        earlier = None if before is None else ambid.pole_map(load_model(machine, before))
    data = found.to_json() | ({} if earlier is None else {"before": earlier.to_json()})
    conclude(
        found, data, json_file, quiet, lambda: () if plot is None else [ambid.plot.save_poles(found, plot, earlier)]
    )


def campbell_command(
    rig: RigFile,
    model: Uncertain = None,
    measured: Annotated[
        list[Path],
        typer.Option(
            "--measured",
            metavar="MODEL",
            help="Models identified at one speed each, to be held against the diagram; default: the model's own "
            "operating points. Repeatable.",
        ),
    ] = [],  # noqa: B006
    speeds: Annotated[
        str | None,
        typer.Option(metavar="FROM:TO", help="[rad/s]; default: from rest to a quarter beyond what was measured."),
    ] = None,
    exact: Exact = False,
    json_file: JsonFile = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw the Campbell diagram.")] = None,
    quiet: Quiet = False,
) -> None:
    """Tell natural frequencies over the speed, forward and backward, beside those identified at measured speeds."""
    from ambid.robustness.whirl import SPEEDS  # not at the top: --help need not open that room

    ambid.plot.check_format(plot)
    inputs: Files = {"RIG": rig, "--model": model, "--measured": measured}
    require_outputs(inputs, {"--json": json_file, "--plot": plot})
    over = None if speeds is None else np.linspace(*_speeds(speeds), SPEEDS).tolist()
    start = load_model(load_rig(rig, exact), model)
    known = [ambid.Model.load(path) for path in measured] if measured else None
    with stoppable():
        found = ambid.campbell(start, over, measured=known)
    conclude(
        found,
        found.to_json(),
        json_file,
        quiet,
        lambda: () if plot is None else [ambid.plot.save_campbell(found, plot)],
    )


def _speeds(text: str) -> tuple[float, float]:
    """Ends of the diagram [rad/s]."""
    from ambid.rig.rig import SPEED  # not at the top: --help need not open that room

    low, high = span("--speeds", text, "FROM:TO", "0:1000")
    if not SPEED.low <= low < high <= SPEED.high:
        raise InputError(
            f"--speeds {text}: expected FROM below TO, from {SPEED.low:g} to {SPEED.high:g} rad/s, "
            "such as --speeds 0:1000"
        )
    return low, high
