"""The command `frequency-response`: measured and modelled responses, with the band of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

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
)
from ambid.cli.outputs import Files, conclude, pictures, require_new, require_outputs
from ambid.cli.signals import stoppable


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
        "\n".join([*map(repr, measured), "", repr(comparison), *by_excitation, *found]),
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
