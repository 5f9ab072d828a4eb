"""The subcommands, their names and help."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any

import typer
from typer.main import get_command

import ambid
from ambid.cli.designing import design_command, excitation_command
from ambid.cli.diagnosing import check_command, compare_command, diagnose_command, rank_command
from ambid.cli.experiments import demo_command, effects_command, init_command, simulate_command
from ambid.cli.exporting import export_command
from ambid.cli.identifying import campaign_command, identify_command, static_load_command
from ambid.cli.options import Commands, DiagnoseCommand
from ambid.cli.standing import campbell_command, frequency_response_command, margins_command, poles_command
from ambid.cli.virtual import monte_carlo_command
from ambid.cli.working import workbench_command

app = typer.Typer(
    name="ambid",
    cls=Commands,
    help="Parameters of active magnetic bearings from the machine's own closed loop. Forces: f = K_i i + K_s s.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("init")(init_command)
app.command("check")(check_command)
app.command("identify")(identify_command)
app.command("static-load")(static_load_command)
app.command("campaign")(campaign_command)
app.command("compare")(compare_command)
app.command("rank")(rank_command)
app.command("diagnose", cls=DiagnoseCommand)(diagnose_command)
app.command("frequency-response")(frequency_response_command)
app.command("margins")(margins_command)
app.command("poles")(poles_command)
app.command("campbell")(campbell_command)
app.command("export")(export_command)
app.command("workbench", cls=DiagnoseCommand)(workbench_command)
app.command("effects")(effects_command)
app.command("excitation")(excitation_command)
app.command("design")(design_command)
app.command("simulate")(simulate_command)
app.command("monte-carlo")(monte_carlo_command)
app.command("demo")(demo_command)


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        print(f"ambid {ambid.__version__}")
        raise typer.Exit


@cache
def command() -> Callable[[], Any]:
    """Parse and run; it is put together once, where several commands run in one process."""
    return get_command(app)
