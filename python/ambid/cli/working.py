"""The command `workbench`: a page on which a person compares, adds, fits and exports."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from ambid.cli.files import load_model, load_records, load_rig, map_options, require_first_point
from ambid.cli.options import (
    Allow,
    Columns,
    Exact,
    JsonFile,
    ModelFile,
    Period,
    Quiet,
    RecordFiles,
    RigFile,
    SampleRate,
    Validation,
)
from ambid.cli.outputs import PRINTED, STOPPED, Files, conclude, require_outputs
from ambid.cli.signals import droppable, exit_code, stoppable, stopped
from ambid.results import of_unit

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
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Open a page to work on: compare, add effects, fit, undo, export; Ctrl-C ends it."""
    from ambid.workbench import Bench, Session, Windows, held, require_server, serve  # not at the top, for --help

    require_server()
    inputs: Files = {"RIG": rig, "RECORD": records, "--validate": validate, "--model": model}
    require_outputs(inputs, {"--json": json_file})
    require_first_point(rig, records)
    machine, columns = load_rig(rig, exact), map_options(columns)
    start, loaded = load_model(machine, model), load_records(machine, records, period, columns, sample_rate, allow)
    kept = load_records(machine, validate, period, columns, sample_rate, allow)
    options = {
        "period": period,
        "mapping": columns and f"ambid.ChannelMap.parse({columns!r})",
        "sample_rate": sample_rate,
        "allow": allow and repr(allow),
    }
    read_with = ", ".join(f"{name}={value}" for name, value in options.items() if value)
    with stoppable():
        windows = Windows(Session.begin(Bench(start, tuple(loaded), tuple(kept), model, read_with)))
    aside = sys.stderr if json_file == PRINTED else sys.stdout
    addresses: list[str] = []

    def said(address: str) -> None:
        addresses.append(address.rsplit("/", 2)[0] + "/")  # without the token, which opens the page
        print(address, file=aside, flush=True)

    with droppable():
        serve(windows, port, say=said, opens_browser=not no_browser)
    print(f"{stopped()} {GONE}", file=sys.stderr)
    left = [held(session) for session in windows.sessions]
    data = {"address": addresses[0], "rig": machine.name, "windows": left, STOPPED: True}
    conclude("\n".join(line for own in left for line in _lines(own)), data, json_file, quiet, is_stopped=True)
    raise typer.Exit(exit_code())


def _lines(own: dict[str, Any]) -> list[str]:
    """What one window held."""
    kept = own["validation_misfit"]
    beside = "" if kept is None else f", {kept:.3f} on the records to validate on"
    return [
        f"steps: {'; '.join(own['steps'])}",
        f"effects: {', '.join(own['effects']) or 'none'}",
        f"misfit {own['misfit']:.3f}, bound {own['misfit_bound']:.3f}{beside}",
        *(f"  {name:34s} {p['value']:.6g}{of_unit(p['unit'])}" for name, p in own["parameters"].items()),
    ]
