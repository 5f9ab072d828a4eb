"""The command `workbench`: a page on which a person compares, adds, fits and exports."""

from __future__ import annotations

from typing import Annotated

import typer

import ambid
from ambid.cli.files import load_model, load_records
from ambid.cli.options import Allow, Columns, ModelFile, Period, RecordFiles, RigFile, SampleRate, Validation
from ambid.cli.signals import stoppable

GONE = "the workbench; what was not exported is gone"


def workbench_command(
    rig: RigFile,
    records: RecordFiles,
    validate: Validation = [],  # noqa: B006
    model: ModelFile = None,
    port: Annotated[int, typer.Option(help="To listen at on 127.0.0.1; default: one that is free.")] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address; open no browser.")] = False,
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    allow: Allow = [],  # noqa: B006
) -> None:
    """Open a page to work on: compare, add effects, fit, undo, export; Ctrl-C ends it."""
    from ambid.workbench import Bench, Session, require_server, serve  # not at the top: --help need not open that room

    require_server()
    machine = ambid.Rig.load(rig)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate, allow)
    kept = load_records(machine, validate, period, columns, sample_rate, allow)
    options = {
        "period": period,
        "mapping": columns and f"ambid.ChannelMap.parse({columns!r})",
        "sample_rate": sample_rate,
        "allow": allow and repr(allow),
    }
    read_with = ", ".join(f"{name}={value}" for name, value in options.items() if value)
    with stoppable(GONE):
        first = Session.begin(Bench(start, tuple(loaded), tuple(kept), model, read_with))
        serve(first, port, say=lambda address: print(address, flush=True), opens_browser=not no_browser)
