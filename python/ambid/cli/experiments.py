"""Commands that bring their own data: `init`, `effects`, `simulate`, `demo`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from inspect import signature
from math import isfinite
from pathlib import Path
from typing import Annotated, Any

import typer

import ambid
from ambid.cli.files import load_model, load_rig, naming_unstable
from ambid.cli.options import (
    Channels,
    Exact,
    Force,
    JsonFile,
    ModelFile,
    Quiet,
    RigFile,
    known_effects,
    noise_of,
    with_effects,
)
from ambid.cli.outputs import conclude, require_new, require_outputs
from ambid.cli.signals import stoppable
from ambid.errors import InputError, WrongUnit
from ambid.findings import Finding, Kind, has
from ambid.results import of_unit, plain, speed_text
from ambid.writing import is_device, make_folder, whole_file

LONGEST_SIMULATION = 10_000_000
"""Samples of a virtual experiment; more would not fit into the memory of a small computer."""

VIRTUAL_TRAVEL = Kind(
    "virtual_travel_beyond_gap",
    "warning",
    "reaches {largest_m:.4g} m, the air gap is {air_gap_m:g} m",
    "nothing limits it here; on the machine it would touch, so give a smaller --amplitude",
)
"""What is said of a virtual record whose y goes beyond the air gap: the amplitude is the cause, not the unit."""


def _kinds(incomplete: str) -> list[str]:
    """Kinds of rig files that shell completion offers."""
    from ambid.rig.template import KINDS  # not at the top: --help need not open that room

    return [kind for kind in KINDS if kind.startswith(incomplete)]


def init_command(
    kind: Annotated[
        str, typer.Argument(metavar="[KIND]", help="pid, state_space, levitator or modal_rotor.", autocompletion=_kinds)
    ] = "pid",
    out: Annotated[Path, typer.Option("--out", metavar="RIG", help="File to write (.toml).")] = Path("rig.toml"),
    force: Force = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Write a commented rig file to put the numbers of a machine into; as it is, it loads and runs."""
    from ambid.rig.template import KINDS, rig_template  # not at the top: --help need not open that room

    text = rig_template(kind)
    if out.suffix.lower() != ".toml":
        raise InputError(f"--out {out}: the suffix is {out.suffix or 'missing'}; expected .toml")
    require_outputs({}, {"--out": out, "--json": json_file}, replaced=["--out"])
    require_new("--out", out, force)

    def saved() -> Sequence[Path]:
        with whole_file(out) as stream:
            stream.write(text.encode())
        return ()  # it is named below

    conclusion = f"{out}: {KINDS[kind]}; put the numbers of your machine in, then: ambid check {out}"
    conclude(conclusion, {"rig": str(out), "kind": kind}, json_file, quiet, saved)


def effects_command(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="One effect; default: all.", autocompletion=known_effects)
    ] = None,
    rig: Annotated[Path | None, typer.Option(metavar="RIG", help="Ranges on this rig; default: the demo's.")] = None,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """List the catalogue: physics, equation, parameters with what is allowed, signature in the residual, source."""
    require_outputs({"--rig": rig}, {"--json": json_file})
    chosen = ambid.CATALOGUE if name is None else (ambid.effects.find(name),)
    machine = ambid.Rig.load(ambid.demo.DATA / "rig.toml" if rig is None else rig)
    if rig is None:  # at rest not every effect would have its parameters
        machine = machine.replace(speed=200.0)
    with stoppable():
        entries = [_entry(effect, machine) for effect in chosen]
    head = f"parameters and their ranges on {machine.name!r} at {speed_text(machine.speed)}"
    data = {"rig": machine.name, "speed": machine.speed, "effects": entries}
    conclude("\n\n".join([*map(_entry_text, entries), head]), data, json_file, quiet)


def _entry(effect: ambid.Effect, rig: ambid.Rig) -> dict[str, Any]:
    """Plain data of an effect; null where a range has no end."""
    own = effect.parameters(rig)
    constants = signature(type(effect)).parameters.values()
    return {
        "name": effect.name,
        "physics": effect.physics,
        "equation": effect.equation,
        "parameters": [
            {
                "name": p.name,
                "meaning": p.meaning,
                "unit": p.unit,
                "lower": p.lower if isfinite(p.lower) else None,
                "upper": p.upper if isfinite(p.upper) else None,
                "typical": p.probe,
            }
            for p in own
        ],
        "not_on_this_rig": effect.why_not(rig),
        "settings": {c.name: c.default for c in constants if c.name not in {p.name for p in own}},
        "signature": effect.signature,
        "source": effect.source,
    }


def _entry_text(entry: dict[str, Any]) -> str:
    lines = [f"{entry['name']}: {entry['physics']}"]
    if entry["equation"]:
        lines.append(f"    {entry['equation']}")
    for p in entry["parameters"]:
        low, high = ("any" if end is None else f"{end:g}" for end in (p["lower"], p["upper"]))
        span = f"{low:>8s} .. {high:8s} {of_unit(p['unit']).strip():8s} typical {p['typical']:<8g}"
        lines.append(f"    {p['name']:20s} {span} {p['meaning']}".rstrip())
    if entry["not_on_this_rig"]:
        lines.append(f"    makes no sense on this rig: {entry['not_on_this_rig']}")
    if entry["settings"]:
        lines.append(f"    settings: {', '.join(f'{name} = {value}' for name, value in entry['settings'].items())}")
    return "\n".join([*lines, f"    shows as: {entry['signature']}", f"    source: {entry['source']}"])


def simulate_command(
    rig: RigFile,
    out: Annotated[Path, typer.Option("--out", metavar="RECORD", help="Record to write (.csv, .mat, .h5, .parquet).")],
    seconds: Annotated[float, typer.Option(help="Length; rounded up to whole periods.")] = 2.0,
    amplitude: Annotated[float, typer.Option(help="Of the pseudo-random binary excitation [A].")] = 0.1,
    effect: Annotated[
        list[str],
        typer.Option(
            metavar="NAME:param=value,...",
            help="Physics beyond the base model, see `effects`; repeatable.",
            autocompletion=known_effects,
        ),
    ] = [],  # noqa: B006
    sensor_noise: Annotated[float, typer.Option(help="Rms on every displacement [m].")] = 50e-9,
    current_noise: Annotated[float, typer.Option(help="Rms on every recorded current [A].")] = 0.01,
    channel: Channels = [],  # noqa: B006
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    model: ModelFile = None,
    force: Force = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Run a virtual experiment and write its record."""
    from ambid.record.writers import require_format  # not at the top: --help need not open that room

    require_format(out)
    require_outputs({"RIG": rig, "--model": model}, {"--out": out, "--json": json_file}, replaced=["--out"])
    if is_device(out):
        raise InputError(f"--out {out}: is no regular file; give one")
    require_new("--out", out, force)
    machine = load_rig(rig, exact)
    start = with_effects(load_model(machine, model), effect)
    excitation = excitation_of(machine, seconds, amplitude)
    with stoppable(), naming_unstable(rig, start, model):
        made = start.virtual_experiment(
            excitation,
            sensor_noise=sensor_noise,
            current_noise=current_noise,
            further_noise=noise_of(channel, machine),
            seed=seed,
        )
    _require_possible(made, machine, out, amplitude)
    record = ambid.Record.from_arrays(
        **{signal: getattr(made, signal) for signal in ("y", "i_e", "i_c", "r", "further", "axes", "sample_rate")},
        name=out.stem,
        rig=machine,
    )  # what a reader will find: the file may be somebody else's by the time that it is read
    made.save(out)
    findings = [_of_virtual(own) for own in record.findings]
    summary = {
        "record": str(out),
        "samples": record.samples,
        "seconds": record.seconds,
        "period_samples": record.period,
        "periods": record.periods,
        "effects": [own.name for own in start.effects],
        "parameters": {p.name: {"value": p.value, "unit": p.unit} for p in start.parameters},
        "settings": plain({own.name: own.settings() for own in start.effects}),
        "notes": [],
    }
    lines = [str(record), *_values(start), *(f"{own.severity}: {own.line()}" for own in findings)]
    conclude("\n".join(lines), summary, json_file, quiet, lambda: [out], findings=findings)


def _of_virtual(finding: Finding) -> Finding:
    """What is found of a record, of one that was simulated."""
    from ambid.record.checks import BEYOND_AIR_GAP  # not at the top: --help need not open that room

    return VIRTUAL_TRAVEL(finding.where, **finding.values) if has([finding], BEYOND_AIR_GAP) else finding


def _values(model: ambid.Model) -> Iterator[str]:
    """The values of every effect, and its settings."""
    for effect in model.effects:
        own = [p for p in model.parameters if p.name.startswith(f"{effect.name}.")]
        values = [f"{p.name.partition('.')[2]} = {p.value:.6g}{of_unit(p.unit)}" for p in own]
        values += [f"{name} = {value}" for name, value in effect.settings().items()]
        yield f"{effect.name}: {', '.join(values)}"


def _require_possible(made: ambid.Record, rig: ambid.Rig, out: Path, amplitude: float) -> None:
    """Refuse to write what no machine does, and no command would read."""
    from ambid.record.checks import require_ampere, require_metres  # not at the top: --help need not open that room

    currents = {"i_e": made.i_e, "i_c": made.i_c}
    try:
        require_metres(str(out), "y", made.axes, made.y, rig)
        for signal, values in currents.items():
            for axis, own in zip(made.axes, () if values is None else values.T, strict=True):
                require_ampere(str(out), f"{signal}.{axis}", own, rig)
    except WrongUnit as error:
        raise InputError(
            f"--amplitude {amplitude:g}: {error.problem}; give a smaller amplitude or less noise; {out} was not written"
        ) from None


def demo_command(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for tables and pictures.")] = Path(
        "ambid-demo"
    ),
    force: Force = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Run the whole story on data that come with the package."""
    make_folder(out)
    files = [out / name for name in ambid.demo.FILES]
    require_outputs({}, {"--json": json_file, "--out": files})
    if not force:
        _require_own_folder(out, files, json_file)
    with stoppable(f"in the story; the files in {out} are whole, but some may be missing, or of a story before"):
        result = ambid.demo.run(out, say=lambda text: None if quiet else print(text))
    conclude(None, result, json_file, quiet=True)


def _require_own_folder(folder: Path, files: list[Path], json_file: Path | None) -> None:
    """Refuse to replace a file of the demo's names beside others: it may be somebody's own."""
    found = [path for path in files if path.exists()]
    others = {path for path in folder.iterdir() if not path.name.startswith(".")} - {*files, json_file}
    if found and others:
        raise InputError(
            f"--out {folder}: {found[0].name} is there already, beside other files; give another folder, or replace it "
            "with --force"
        )


def excitation_of(rig: ambid.Rig, seconds: float, amplitude: float) -> Any:
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
    return ambid.prbs(order, amplitude=amplitude, hold=hold, axes=len(rig.axes), periods=periods)
