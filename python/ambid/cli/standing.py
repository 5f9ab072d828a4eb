"""The command `margins`: how far the loop stands from instability."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, cast

import typer

import ambid
from ambid.cli.files import load_model
from ambid.cli.options import JsonFile, Quiet, RigFile
from ambid.cli.outputs import conclude, require_outputs
from ambid.cli.signals import stoppable
from ambid.cli.terminal import progress, with_time_left


def margins_command(
    rig: RigFile,
    model: Annotated[
        Path | None, typer.Option("--model", metavar="MODEL", help="Of what --save wrote, with its uncertainty.")
    ] = None,
    at: Annotated[str, typer.Option(metavar="controller|sensor", help="Where the loop is broken.")] = "controller",
    draws: Annotated[int | None, typer.Option(help="Of the parameters; default: 500.")] = None,
    seed: Annotated[int, typer.Option(help="Of the draws.")] = 0,
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
    start = load_model(ambid.Rig.load(rig), model)
    with stoppable(), progress(quiet, "margins") as told:
        tell = with_time_left(told)
        found = ambid.margins(
            start,
            at=cast(Literal["controller", "sensor"], at),
            draws=DRAWS if draws is None else draws,
            seed=seed,
            progress=lambda done, total: tell("draws", done, total),
        )
    conclude(
        found,
        found.to_json(),
        json_file,
        quiet,
        lambda: () if plot is None else [ambid.plot.save_sensitivity(found, plot)],
    )
