"""Commands that plan experiments: `excitation`, `design`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

import ambid
from ambid.cli.experiments import LONGEST_SIMULATION
from ambid.cli.files import load_model, load_records, load_rig, naming_unstable
from ambid.cli.options import (
    Channels,
    Columns,
    Exact,
    Force,
    JsonFile,
    ModelFile,
    Period,
    Quiet,
    RigFile,
    SampleRate,
    assignment,
    known_effects,
    names,
    noise_of,
    span,
    with_effects,
)
from ambid.cli.outputs import Files, conclude, require_new, require_outputs
from ambid.cli.signals import stoppable
from ambid.errors import InputError
from ambid.excitation import MOST_ORDER, MULTISINE, PRBS
from ambid.writing import is_device

if TYPE_CHECKING:
    from ambid.designs import Design, Instruments, Limits, Proposals
    from ambid.record import Measurement

FullScale = Annotated[
    float | None, typer.Option(metavar="AMPERE", help="What full scale of a .wav file stands for; default: the peak.")
]
Travel = Annotated[float, typer.Option(help="Part of the air gap that y may reach.")]
Current = Annotated[float, typer.Option(help="Part of the bias current that i_c may reach.")]
SlewRate = Annotated[
    float | None, typer.Option(metavar="A/S", help="Largest slope of i_c: supply voltage over inductance.")
]


def excitation_command(
    rig: RigFile,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="To be played (.csv, .mat, .wav).")],
    signal: Annotated[str, typer.Option(help="prbs or multisine.")] = PRBS,
    amplitude: Annotated[float, typer.Option(help="Peak of i_e [A]; [V] of voltage-driven coils.")] = 0.1,
    periods: Annotated[int, typer.Option(help="Whole periods.")] = 8,
    order: Annotated[int, typer.Option(help="Of the shift register of a prbs: 2^order - 1 chips.")] = 11,
    hold: Annotated[int, typer.Option(help="Samples per chip of a prbs.")] = 2,
    period: Annotated[int, typer.Option(help="Samples per period of a multisine.")] = 4096,
    band: Annotated[
        str | None, typer.Option(metavar="LOW:HIGH", help="Of a multisine [Hz]; default: a tenth of the sample rate.")
    ] = None,
    axes: Annotated[str | None, typer.Option(metavar="NAME,...", help="Axes that are excited; default all.")] = None,
    seed: Annotated[int, typer.Option(help="Chooses where a prbs begins.")] = 0,
    travel: Travel = 0.05,
    current: Current = 0.2,
    slew_rate: SlewRate = None,
    full_scale: FullScale = None,
    model: ModelFile = None,
    force: Force = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Write what to play on the machine, and predict what it would do there."""
    _require_out({"RIG": rig, "--model": model}, out, json_file, force)
    machine = load_rig(rig, exact)
    limits = ambid.Limits(travel=travel, current=current, slew_rate=slew_rate)
    chosen = _columns(machine, axes)
    if signal == PRBS:
        samples = (2 ** min(max(order, 0), MOST_ORDER) - 1) * hold
        _require_short(samples, periods)
        played = ambid.prbs(order, amplitude=amplitude, hold=hold, axes=len(chosen), periods=periods, seed=seed)
    elif signal == MULTISINE:
        if not (np.isfinite(amplitude) and amplitude > 0.0):
            raise InputError(f"--amplitude {amplitude:g}: expected a finite number above zero")
        if periods < 1:
            raise InputError(f"--periods {periods}: expected 1 or more")
        _require_short(period, periods)
        inside, rate = _band(machine, period, band), machine.sample_rate
        wave = ambid.multisine(period, rms=1.0, band_hz=inside, sample_rate=rate, axes=len(chosen), phases="clipped")
        played, samples = np.tile(wave * (amplitude / np.abs(wave).max(axis=0)), (periods, 1)), period
    else:
        raise InputError(f"--signal {signal}: expected {PRBS} or {MULTISINE}")
    i_e = np.zeros((len(played), len(machine.axes)))
    i_e[:, chosen] = played
    start = load_model(machine, model)
    with stoppable(), naming_unstable(rig, start, model):
        predicted = ambid.forecast(start, i_e, period=samples, limits=limits)
    data = {"excitation": str(out), **predicted.to_json(), **_scale(out, i_e, full_scale)}
    conclude(predicted, data, json_file, quiet, lambda: _played(out, machine, i_e, full_scale))


def design_command(
    rig: RigFile,
    record: Annotated[
        list[Path],
        typer.Option(
            "--record",
            metavar="RECORD",
            help="Fitted first: its values and its noise count; repeatable. Options state that of more.",
        ),
    ] = [],  # noqa: B006
    period: Period = None,
    columns: Columns = [],  # noqa: B006
    sample_rate: SampleRate = None,
    accuracy: Annotated[
        list[str],
        typer.Option(
            metavar="NAME=VALUE", help="Half of the 95 % interval that is wanted, such as K_i=1% or tau_e=2e-6."
        ),
    ] = [],  # noqa: B006
    effect: Annotated[
        list[str],
        typer.Option(metavar="NAME", help="Effect that is to be seen; repeatable.", autocompletion=known_effects),
    ] = [],  # noqa: B006
    apart: Annotated[
        list[str],
        typer.Option(
            metavar="NAME:param=value,...",
            help="Effects that are to be distinguished, each as it was found: which experiment next? Twice or more.",
            autocompletion=known_effects,
        ),
    ] = [],  # noqa: B006
    seconds: Annotated[float | None, typer.Option(help="Longest record; default: what the accuracy needs.")] = None,
    signal: Annotated[str | None, typer.Option(help="prbs or multisine; default: the better.")] = None,
    sensor_noise: Annotated[float | None, typer.Option(help="Rms on every displacement [m]; default 5e-8.")] = None,
    current_noise: Annotated[float | None, typer.Option(help="Rms on every current [A]; default 0.01.")] = None,
    channel: Channels = [],  # noqa: B006
    without_currents: Annotated[bool, typer.Option("--without-currents", help="i_c is not recorded.")] = False,
    spread: Annotated[
        float, typer.Option(help="Part of a multisine's power on all lines, so that misfit shows.")
    ] = 0.05,
    peak: Annotated[float | None, typer.Option(metavar="AMPERE", help="Largest i_e.")] = None,
    travel: Travel = 0.05,
    current: Current = 0.2,
    slew_rate: SlewRate = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Excitation to be played (.csv, .mat, .wav).")
    ] = None,
    full_scale: FullScale = None,
    model: ModelFile = None,
    force: Force = False,
    exact: Exact = False,
    json_file: JsonFile = None,
    quiet: Quiet = False,
) -> None:
    """Find the excitation that gives a wanted accuracy or shows an effect, within limits, and report what it shows."""
    inputs: Files = {"RIG": rig, "--record": record, "--model": model}
    if out is not None:
        _require_out(inputs, out, json_file, force)
    require_outputs(inputs, {"--json": json_file})
    from ambid.designs.separation import CURRENT_NOISE  # not at the top: --help need not open that room

    of_record = {"--period": period, "--map": columns or None, "--sample-rate": sample_rate}
    if not record and (given := [option for option, value in of_record.items() if value is not None]):
        raise InputError(f"{given[0]} is of a record; name it with --record, or leave it out")
    machine = load_rig(rig, exact)
    start = load_model(machine, model)
    wanted = dict(assignment("--accuracy", text, "K_i=1%") for text in accuracy)
    limits = ambid.Limits(travel=travel, current=current, excitation=peak, slew_rate=slew_rate)
    with stoppable(), naming_unstable(rig, start, model):
        if record:
            stated = {"y": sensor_noise, "i_c": current_noise, **noise_of(channel, machine)}
            more = {name: rms for name, rms in stated.items() if rms is not None}
            records = load_records(machine, record, period, columns, sample_rate)
            _require_not_recorded(more, records)
            fit = ambid.identify(start, records)
            start, instruments = fit.model, ambid.Instruments.of(fit.comparison).beside(more)
        else:
            instruments = ambid.Instruments.stated(
                len(machine.axes),
                50e-9 if sensor_noise is None else sensor_noise,
                CURRENT_NOISE if current_noise is None else current_noise,
                noise_of(channel, machine),
            )
        found = ambid.design(
            start,
            instruments=instruments.without_currents() if without_currents else instruments,
            accuracy=wanted,
            effects=effect,
            limits=limits,
            seconds=seconds,
            signal=signal,
            spread=spread,
        )
        following = _following(start, apart, found, instruments, limits, without_currents)
    writers = []
    data = found.to_json() | ({} if following is None else {"next_experiments": following.to_json()})
    if out is not None:
        data |= {"excitation": str(out), **_scale(out, found.i_e, full_scale)}
        writers.append(lambda: _played(out, machine, found.i_e, full_scale))
    conclude(found if following is None else f"{found}\n{following}", data, json_file, quiet, *writers)


def _require_not_recorded(noise: Iterable[str], records: Sequence[Measurement]) -> None:
    """Refuse a noise that is stated of what a record gives it of."""
    recorded = {name for own in records for name in own.channels}
    for name in noise:
        if name in recorded | {channel.partition(".")[0] for channel in recorded if name in ("y", "i_c")}:
            option = {"y": "--sensor-noise", "i_c": "--current-noise"}.get(name, f"--channel {name}")
            raise InputError(f"{option}: --record gives the noise of {name}; omit the option, or the record")


def _following(
    start: ambid.Model,
    apart: list[str],
    found: Design,
    instruments: Instruments,
    limits: Limits,
    without_currents: bool,
) -> Proposals | None:
    """Experiments after the designed one that would distinguish effects."""
    if not apart:
        return None
    hypotheses = {}
    for text in apart:
        own = with_effects(start, [text])
        hypotheses[own.effects[-1].name] = own
    if len(hypotheses) < max(2, len(apart)):
        raise InputError("--apart: name two effects or more that are to be distinguished, each once")
    present = instruments.without_currents() if without_currents else instruments
    more = instruments if without_currents else None
    period = len(found.option.wave)
    return ambid.tell_apart(hypotheses, found.i_e, period, present, more_instruments=more, limits=limits)


def _played(out: Path, rig: ambid.Rig, i_e: np.ndarray, full_scale: float | None) -> list[Path]:
    ambid.save_excitation(out, rig, i_e, full_scale=full_scale)
    return [out]


def _require_out(inputs: Files, out: Path, json_file: Path | None, force: bool) -> None:
    """Refuse a file that cannot be written, or is there already, before any work is done."""
    from ambid.designs.playing import require_playable  # not at the top: --help need not open that room

    require_playable(out)
    require_outputs(inputs, {"--out": out, "--json": json_file}, replaced=["--out"])
    if not is_device(out):
        require_new("--out", out, force)


def _require_short(period: int, periods: int) -> None:
    """Refuse an excitation that would not fit into memory, before it is made."""
    if period * periods > LONGEST_SIMULATION:
        raise InputError(
            f"{periods} periods of {period} samples: expected {LONGEST_SIMULATION} samples at the most; give fewer or "
            "shorter periods"
        )


def _columns(rig: ambid.Rig, axes: str | None) -> list[int]:
    """Indices of the axes that are excited."""
    wanted = names("--axes", axes) or list(rig.axes)
    unknown = [name for name in wanted if name not in rig.axes]
    if unknown or len(set(wanted)) < len(wanted):
        raise InputError(f"--axes {axes}: expected axes of the rig, each once: {', '.join(rig.axes)}")
    return [rig.axes.index(name) for name in wanted]


def _band(rig: ambid.Rig, period: int, text: str | None) -> tuple[float, float]:
    """Lowest and highest frequency of a multisine [Hz]."""
    if text is None:
        return rig.sample_rate / max(period, 1), rig.sample_rate / 10.0
    return span("--band", text, "LOW:HIGH in Hz", "5:1500")


def _scale(out: Path, i_e: np.ndarray, full_scale: float | None) -> dict[str, float]:
    """What full scale of the file stands for, where it has one."""
    from ambid.designs.playing import full_scale_of  # not at the top: --help need not open that room

    return {"full_scale": full_scale_of(i_e, full_scale)} if out.suffix.lower() == ".wav" else {}
