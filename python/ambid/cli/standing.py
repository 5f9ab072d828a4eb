"""Commands on how the loop stands: `margins`, `poles`, `campbell`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, cast

import numpy as np
import typer

import ambid
from ambid.cli.files import load_model, load_rig
from ambid.cli.options import Before, Exact, JsonFile, Quiet, RigFile, span
from ambid.cli.outputs import Files, conclude, require_outputs
from ambid.cli.signals import stoppable
from ambid.cli.terminal import progress, with_time_left
from ambid.errors import InputError

Uncertain = Annotated[
    Path | None, typer.Option("--model", metavar="MODEL", help="Of what --save wrote, with its uncertainty.")
]


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
