"""The command `ambid`: each subcommand reads files, does one job, prints tables, and writes what it is asked for."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

import ambid
from ambid import demo as demonstration
from ambid.compare import compare
from ambid.diagnose import diagnose
from ambid.errors import AmbidError, InputError
from ambid.estimate import Estimate
from ambid.excitation import prbs
from ambid.identify import identify
from ambid.model import Model
from ambid.plot import check_format, save_comparison
from ambid.record import Record, StaticLoading
from ambid.rig import Rig
from ambid.static_load import static_load

app = typer.Typer(
    name="ambid",
    help="Parameters of active magnetic bearings from the machine's own closed loop. Forces: f = K_i i + K_s s.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
status = Console(stderr=True)
LONGEST_SIMULATION = 10_000_000
"""Samples of a virtual experiment; more would not fit into the memory of a small computer."""

RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (.toml).")]
RecordFiles = Annotated[list[Path], typer.Argument(metavar="RECORD...", help="Records: .csv, .mat, .h5, .parquet.")]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON; - prints it.")]
ModelFile = Annotated[Path | None, typer.Option("--model", metavar="MODEL", help="Start from what --save wrote.")]
PlotFile = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw measured against simulated.")]
Period = Annotated[int | None, typer.Option(help="Samples per period of the excitation; default: found from i_e.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no tables.")]


@app.command("identify")
def identify_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    free: Annotated[str | None, typer.Option(metavar="NAME,...", help="Parameters to fit, such as K_i,tau_e.")] = None,
    fix: Annotated[list[str], typer.Option(metavar="NAME[=VALUE]", help="Keep at the start value, or at VALUE.")] = [],  # noqa: B006
    share: Annotated[list[str], typer.Option(metavar="NAME=MEMBER,...", help="One parameter for several axes.")] = [],  # noqa: B006
    per_axis: Annotated[list[str], typer.Option(metavar="NAME", help="One value per axis, such as tau_e.")] = [],  # noqa: B006
    bound: Annotated[list[str], typer.Option(metavar="NAME=LOW:HIGH", help="Bounds in SI units.")] = [],  # noqa: B006
    weight: Annotated[list[str], typer.Option(metavar="CHANNEL=W", help="Weight of y, i_c or a channel.")] = [],  # noqa: B006
    starts: Annotated[int, typer.Option(help="Number of starts.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the further starts.")] = 0,
    max_evaluations: Annotated[int, typer.Option(help="Per start.")] = 100,
    period: Period = None,
    json_file: JsonFile = None,
    save: Annotated[Path | None, typer.Option(metavar="MODEL", help="Write the identified model.")] = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Find K_i, K_s and tau_e by closed-loop identification."""
    _require_folders(json_file, save, plot)
    check_format(plot)
    start, loaded = _model(rig, model), _records(rig, records, period)
    for text in share:
        name, members = _assignment("--share", text, "K_i.A=K_i.A_zeta,K_i.A_eta")
        start = start.share(name, members.split(","))
    for name in per_axis:
        start = start.per_axis(name)
    held = dict(_assignment("--fix", text, "tau_e=0.0003") for text in fix if "=" in text)
    start = start.with_values({name: _number("--fix", value) for name, value in held.items()})
    with _progress(quiet, "identifying") as progress:
        estimate = identify(
            start,
            loaded,
            free=None if free is None else free.split(","),
            fixed=[text.split("=")[0] for text in fix],
            bounds=dict(_bound(text) for text in bound) or None,
            weights={n: _number("--weight", v) for n, v in (_assignment("--weight", t, "i_c=0") for t in weight)},
            starts=starts,
            seed=seed,
            max_evaluations=max_evaluations,
            progress=progress,
        )
    _print(estimate, quiet)
    _write_json(estimate.to_json(), json_file)
    if save is not None:
        estimate.save(save)
    if plot is not None:
        _plot(estimate.model, loaded, plot, quiet)
    _require_done(estimate)


@app.command("static-load")
def static_load_command(
    rig: RigFile,
    loads: Annotated[list[Path], typer.Argument(metavar="LOADS...", help="Static loadings (.csv).")],
    deflection: Annotated[bool, typer.Option("--deflection", help="Take in K_s s of the bent rotor.")] = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Find K_i by static loading: equilibrium of known forces and recorded currents."""
    _require_folders(json_file)
    machine = Rig.load(rig)
    estimate = static_load(machine, [StaticLoading.load(path, machine) for path in loads], deflection=deflection)
    _print(estimate, quiet)
    _write_json(estimate.to_json(), json_file)


@app.command("compare")
def compare_command(
    rig: RigFile,
    records: RecordFiles,
    model: ModelFile = None,
    period: Period = None,
    json_file: JsonFile = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Show where and by how much the model misses the measurement; nothing is fitted."""
    _require_folders(json_file, plot)
    check_format(plot)
    comparison = compare(_model(rig, model), _records(rig, records, period))
    _print(comparison, quiet)
    _write_json(comparison.to_json(), json_file)
    if plot is not None:
        _announce(save_comparison(comparison, plot), quiet)


@app.command("diagnose")
def diagnose_command(
    rig: RigFile,
    records: RecordFiles,
    validate: Annotated[list[Path], typer.Option(metavar="RECORD", help="Record to validate on; repeatable.")] = [],  # noqa: B006
    effects: Annotated[str | None, typer.Option(metavar="NAME,...", help="Add these instead of choosing.")] = None,
    tolerance: Annotated[float, typer.Option(help="Misfit J/dof that is good enough.")] = 1.1,
    model: ModelFile = None,
    period: Period = None,
    json_file: JsonFile = None,
    save: Annotated[Path | None, typer.Option(metavar="MODEL", help="Write the last model.")] = None,
    plot: PlotFile = None,
    quiet: Quiet = False,
) -> None:
    """Name the physics that the model lacks, add it, and watch the misfit fall."""
    check_format(plot)
    _require_folders(json_file, save, plot)
    loaded = _records(rig, records, period)
    found = diagnose(
        _model(rig, model),
        loaded,
        validate=_records(rig, validate, period),
        effects=None if effects is None else effects.split(","),
        tolerance=tolerance,
        say=(lambda _: None) if quiet or not status.is_terminal else lambda line: status.print(line, highlight=False),
    )
    _print(found, quiet)
    _write_json(found.to_json(), json_file)
    if save is not None:
        found.save(save)
    if plot is not None:
        _plot(found.model, loaded, plot, quiet)


@app.command("simulate")
def simulate_command(
    rig: RigFile,
    out: Annotated[Path, typer.Option("--out", metavar="RECORD", help="Record to write (.csv, .mat, .h5, .parquet).")],
    seconds: Annotated[float, typer.Option(help="Length; rounded up to whole periods.")] = 2.0,
    amplitude: Annotated[float, typer.Option(help="Of the pseudo-random binary excitation [A].")] = 0.1,
    sensor_noise: Annotated[float, typer.Option(help="Rms on every displacement [m].")] = 50e-9,
    current_noise: Annotated[float, typer.Option(help="Rms on every recorded current [A].")] = 0.01,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    model: ModelFile = None,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Run a virtual experiment and write its record."""
    _require_folders(json_file, out)
    start = _model(rig, model)
    excitation = virtual_excitation(start.rig, seconds, amplitude)
    record = start.virtual_experiment(excitation, sensor_noise=sensor_noise, current_noise=current_noise, seed=seed)
    record.save(out)
    record = Record.load(out, start.rig)
    _print(record, quiet)
    summary = {
        "record": str(out),
        "samples": record.samples,
        "seconds": record.seconds,
        "period_samples": record.period,
        "periods": record.periods,
        "parameters": {p.name: {"value": p.value, "unit": p.unit} for p in start.parameters},
    }
    _write_json(summary, json_file)


@app.command("demo")
def demo_command(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for tables and pictures.")] = Path(
        "ambid-demo"
    ),
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Run the whole story on data that come with the package."""
    _require_folders(json_file)
    result = demonstration.run(out, say=(lambda _: None) if quiet else print)
    _write_json(result, json_file)


def virtual_excitation(rig: Rig, seconds: float, amplitude: float) -> Any:
    """PRBS for a virtual experiment: at least 5 periods in `seconds`, held so that it reaches fs/4."""
    hold = 2
    samples = seconds * rig.sample_rate
    shortest, longest = 5 * 31 * hold, LONGEST_SIMULATION
    if not shortest <= samples <= longest:
        raise InputError(
            f"--seconds {seconds:g}: expected {shortest / rig.sample_rate:g} (five periods) "
            f"to {longest / rig.sample_rate:g} s at {rig.sample_rate:g} Hz"
        )
    order = next(n for n in range(15, 4, -1) if 5 * (2**n - 1) * hold <= samples)
    periods = -(-int(samples) // ((2**order - 1) * hold))
    return prbs(order, amplitude=amplitude, hold=hold, axes=len(rig.axes), periods=periods)


def _require_folders(*files: Path | None) -> None:
    """Refuse a file that could not be written, before any work is done."""
    for path in files:
        if path is not None and (path.is_dir() or not path.parent.is_dir()):
            raise InputError(f"{path}: cannot be written; give a file in a folder that exists")


def _model(rig: Path, model: Path | None) -> Model:
    machine = Rig.load(rig)
    return Model(machine) if model is None else Model.load(model, machine)


def _records(rig: Path, paths: list[Path], period: int | None) -> list[Record]:
    machine = Rig.load(rig)
    return [Record.load(path, machine, period=period) for path in paths]


def _plot(model: Model, records: list[Record], path: Path, quiet: bool) -> None:
    _announce(save_comparison(compare(model, records), path), quiet)


def _announce(paths: list[Path], quiet: bool) -> None:
    if not quiet:
        print(f"written: {', '.join(map(str, paths))}")


def _print(result: object, quiet: bool) -> None:
    if not quiet:
        print(result)


def _write_json(data: dict[str, Any], path: Path | None) -> None:
    if path is None:
        return
    text = json.dumps(data, indent=1, allow_nan=False)
    if str(path) == "-":
        print(text)
    else:
        path.write_text(text + "\n", encoding="utf-8")


def _assignment(option: str, text: str, example: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise InputError(f"{option} {text}: expected NAME=VALUE, such as {option} {example}")
    return name, value


def _number(option: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option}: {text!r} is no number; give one in SI units, such as 3e-4") from None


def _bound(text: str) -> tuple[str, tuple[float, float]]:
    name, span = _assignment("--bound", text, "tau_e=1e-4:1e-3")
    low, colon, high = span.partition(":")
    if not colon:
        raise InputError(f"--bound {text}: expected NAME=LOW:HIGH, such as --bound tau_e=1e-4:1e-3")
    return name, (_number("--bound", low), _number("--bound", high))


def _require_done(estimate: Estimate) -> None:
    if estimate.status in ("not_identifiable", "max_evaluations", "stopped"):
        raise typer.Exit(1)


@contextmanager
def _progress(quiet: bool, what: str) -> Iterator[Callable[[int, float], None] | None]:
    """A line on stderr that counts evaluations, where a terminal is attached."""
    if quiet or not status.is_terminal:
        yield None
        return
    with status.status(f"{what} ...") as line:
        yield lambda evaluations, cost: line.update(f"{what}: evaluation {evaluations}, cost {cost:.6g}")


@app.callback(invoke_without_command=True)
def _version(version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False) -> None:
    if version:
        print(f"ambid {ambid.__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point: exit 0 done, 2 bad input, 1 the job could not be done."""
    try:
        app()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except AmbidError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
        sys.exit(2)
