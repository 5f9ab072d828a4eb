"""The command `frequency-response`: measured and modelled responses, with the band of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import ambid
from ambid.cli.files import load_model, load_records
from ambid.cli.options import (
    Columns,
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
from ambid.cli.outputs import conclude, pictures, require_outputs
from ambid.cli.signals import stoppable
from ambid.errors import InputError
from ambid.results import plain


def frequency_response_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the measured responses (.csv, .mat); several get numbered names."),
    ] = None,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    force: Force = False,
    json_file: JsonFile = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Make frequency responses of records, with their uncertainty, and hold the model's against them."""
    from ambid.record.frequency_writers import require_response_format  # not at the top: --help need not open that room

    count = sum(record.suffix.lower() != ".toml" for record in records)
    written = [] if out is None else ambid.plot.picture_files(out, count)
    for path in written:
        require_response_format(path)
        if path.exists() and not force:
            raise InputError(f"--out {path}: is there already; give another file, or replace it with --force")
    outputs = {"--out": written, "--json": json_file, "--plot": pictures(plot, records)}
    require_outputs({"RIG": rig, "RECORD": records, "--model": model}, outputs, replaced=["--out"])
    machine = ambid.Rig.load(rig)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate)
    with stoppable():
        measured = [own.frequency_response() if isinstance(own, ambid.Record) else own for own in loaded]
        comparison = ambid.compare(start, measured)

    def saved() -> Sequence[Path]:
        for own, path in zip(measured, written, strict=bool(written)):
            own.save(path)
        return written

    conclude(
        "\n".join([*map(repr, measured), "", repr(comparison), *(note for own in measured for note in own.notes)]),
        {"responses": [_as_dict(own) for own in comparison.records], **comparison.to_json()},
        json_file,
        quiet,
        saved,
        lambda: ambid.plot.save_comparison(comparison, plot) if plot else (),
    )


def _as_dict(own: Any) -> dict[str, Any]:
    """The measured and modelled responses of one record; complex numbers are [re, im]."""
    measured = own.record
    return plain(
        {
            "record": measured.name,
            "frequency_hz": measured.frequency_hz.tolist(),
            "outputs": list(measured.outputs),
            "inputs": list(measured.inputs),
            "response": measured.response.tolist(),
            "std": measured.std.tolist(),
            "model": own.simulated.tolist(),
        }
    )
