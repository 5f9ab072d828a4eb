"""Arguments and options that several commands have, and how their texts are read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

import ambid
from ambid.cli.files import begin_findings
from ambid.errors import InputError, ModelError, RigError, printable

RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (.toml).")]
RecordFiles = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORD...",
        help="Records: .csv, .mat, .h5, .parquet, .tdms; frequency responses: .csv, .mat, .uff. A rig file among them "
        "opens another operating point: the records after it were recorded at its sample rate, speed and bias current.",
    ),
]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON; - prints it.")]
ModelFile = Annotated[Path | None, typer.Option("--model", metavar="MODEL", help="Start from what --save wrote.")]
Before = Annotated[
    Path | None,
    typer.Option(metavar="MODEL", help="Another saved model to draw beside, such as the one without an effect."),
]
PlotFile = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw measured against simulated.")]
Exact = Annotated[
    bool, typer.Option("--exact", help="Take every value of the rig file for exact, whatever its [tolerance].")
]
SaveRig = Annotated[
    Path | None,
    typer.Option(
        "--save-rig",
        metavar="RIG",
        help="Write the rig file (.toml), its values known to a tolerance and named gains updated by the records.",
    ),
]
Period = Annotated[int | None, typer.Option(help="Samples per period of the excitation; default: found from i_e.")]
Columns = Annotated[
    list[str],
    typer.Option(
        "--map",
        metavar="CHANNEL=COLUMN[:FACTOR]|FILE",
        help="Column of a foreign file, and what makes SI units of it, such as y.A_zeta=ch3:1e-6, or a text file of "
        "these; repeatable.",
    ),
]
Channels = Annotated[
    list[str],
    typer.Option(
        "--channel",
        metavar="NAME[:RMS]",
        help="Further signal or channel that is recorded, in white noise: b:2e-3, a.drive_end:0.05; repeatable.",
    ),
]
SampleRate = Annotated[float | None, typer.Option(metavar="HZ", help="Of records whose files state none.")]
Validation = Annotated[
    list[Path],
    typer.Option(
        "--validate", metavar="RECORD...", help="Records to validate on, not used for choosing; rig files as above."
    ),
]
Allow = Annotated[
    list[str],
    typer.Option(
        "--allow",
        metavar="WHAT",
        help="Note what would be refused: travel (y far beyond the air gap), current (far above 100 A); repeatable.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there already.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no tables.")]


def known_effects(incomplete: str) -> list[str]:
    """Effects that shell completion offers for the last name of a list."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{effect.name}" for effect in ambid.CATALOGUE if effect.name.startswith(last)]


class Commands(TyperGroup):
    """The commands; what they say of a wrong option or argument repeats it, and is printable."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """See Click."""
        with _printable():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """See Click."""
        begin_findings()
        with _printable():
            return super().invoke(ctx)


@contextmanager
def _printable() -> Iterator[None]:
    try:
        yield
    except Exception as error:
        message = getattr(error, "message", None)  # that of Click's own errors, wherever Typer keeps Click
        if isinstance(message, str):
            error.message = printable(message)  # type: ignore[attr-defined]
        raise


class DiagnoseCommand(TyperCommand):
    """Takes all records between ``--validate`` and the next option as records to validate on."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write the option before each of them, as the parser needs it."""
        return super().parse_args(ctx, list(_repeated("--validate", args)))


def _repeated(option: str, words: Sequence[str]) -> Iterator[str]:
    own = 0
    for word in words:
        if word.startswith("-"):
            own = int(word == option)
        elif own:
            if own > 1:
                yield option
            own += 1
        yield word


def names(option: str, text: str | None) -> list[str] | None:
    """The members of ``NAME,...``."""
    if text is None:
        return None
    found = [name.strip() for name in text.split(",")]
    if not all(found):
        raise InputError(f"{option} {text!r}: a name is missing; expected NAME,..., or leave {option} out")
    return found


def assignment(option: str, text: str, example: str) -> tuple[str, str]:
    """Name and value of ``NAME=VALUE``."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise InputError(f"{option} {text}: expected NAME=VALUE, such as {option} {example}")
    return name, value


def number(option: str, text: str) -> float:
    """A number in SI units."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option}: {text!r} is no number; give one in SI units, such as 3e-4") from None


def span(option: str, text: str, form: str, example: str) -> tuple[float, float]:
    """The two numbers of a form such as ``FROM:TO``."""
    low, colon, high = text.partition(":")
    if not colon:
        raise InputError(f"{option} {text}: expected {form}, such as {option} {example}")
    return number(option, low), number(option, high)


def bound(text: str) -> tuple[str, tuple[float, float]]:
    """Name and limits of ``NAME=LOW:HIGH``."""
    name, limits = assignment("--bound", text, "tau_e=1e-4:1e-3")
    low, colon, high = limits.partition(":")
    if not colon:
        raise InputError(f"--bound {text}: expected NAME=LOW:HIGH, such as --bound tau_e=1e-4:1e-3")
    return name, (number("--bound", low), number("--bound", high))


def noise_of(channels: Sequence[str], rig: ambid.Rig) -> dict[str, float]:
    """Rms of the noise of further channels, of options such as ``b:2e-3``; 0 where none is stated."""
    from ambid.model.operating_point import selected_outputs  # not at the top: --help need not open that room

    found = dict[str, float]()
    for text in channels:
        name, colon, rms = text.partition(":")
        try:
            found[name] = float(rms) if colon else 0.0
        except ValueError:
            raise InputError(f"--channel {text}: {rms!r} is no number; give an rms, such as b:2e-3") from None
    own = selected_outputs(rig, found)
    return {name: found[name] if name in found else found[name.partition(".")[0]] for name in own}


def with_effects(model: ambid.Model, options: Sequence[str]) -> ambid.Model:
    """Return the model with the effects that options such as ``sensor_lag:time_constant=2e-5`` name.

    Parameters
    ----------
    model : Model
    options : sequence of str
        ``NAME`` or ``NAME:param=value,...``; each `param` is a parameter of the effect, in SI units, or a setting of
        its kind such as the ``z`` of ``seal_forces``; an axis may be given by its name. What is left out is typical
        and small.

    Raises
    ------
    ModelError
        If an effect or one of its parameters is unknown, or a value is no number or outside its range; the message
        begins with the option.
    """
    for option in options:
        try:
            model = _with_effect(model, option)
        except (ModelError, RigError) as error:
            raise ModelError(f"--effect {option}: {error}") from None
    return model


def _with_effect(model: ambid.Model, option: str) -> ambid.Model:
    name, colon, rest = option.partition(":")
    pairs = [_pair(text) for text in rest.split(",")] if colon else []
    given = dict(pairs)
    if len(given) < len(pairs):
        raise ModelError("a parameter is named twice; keep one")
    kind = ambid.effects.find(name)
    constants = signature(type(kind)).parameters
    uncertain = {p.name for p in kind.parameters(model.rig)}
    settings = {
        key: _setting(model.rig.axes, key, given[key], constants[key])
        for key in given
        if key in constants and key not in uncertain
    }
    effect = ambid.effects.find(name, settings)
    values = {key: _value(key, text) for key, text in given.items() if key not in settings}
    known = [p.name for p in effect.parameters(model.rig)]
    unknown = [key for key in values if key not in known]
    if known and unknown:
        others = [key for key in constants if key not in known]
        of_kind = f", and the settings {', '.join(others)}" if others else ""
        raise ModelError(f"no parameter {', '.join(unknown)}; {name} has {', '.join(known)}{of_kind}")
    return _built(model.add(effect, values), effect)


def _built(model: ambid.Model, effect: ambid.Effect) -> ambid.Model:
    """The model, once its loop can be built with the effect's settings."""
    try:
        _ = model.loop
    except LookupError as error:
        settings = ", ".join(f"{key} = {value!r}" for key, value in effect.settings().items())
        raise ModelError(f"{settings}: the rig has no such place or axis ({error}); correct the setting") from None
    return model


def _pair(text: str) -> tuple[str, str]:
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise ModelError(f"{text!r}: expected NAME or NAME:param=value,..., such as loop_delay:delay=5e-5")
    return key, value


def _setting(axes: tuple[str, ...], key: str, text: str, constant: Parameter) -> int | float | str:
    """A setting as the constructor of the effect takes it; an axis by its index."""
    if key == "axis" and text in axes:
        return axes.index(text)
    takes = str(constant.annotation)
    if takes.startswith("tuple"):
        raise ModelError(
            f"{key} = {text!r}: it holds a number of each axis, which an option does not take; leave it out"
        )
    if text.isdecimal() and "int" in takes:
        return int(text)
    if "str" in takes:
        return text
    if "float" in takes:
        return _value(key, text)
    raise ModelError(f"{key} = {text!r} is no whole number; give one, counted from 0")


def _value(key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"{key} = {text!r} is no number; give one in SI units, such as 3e-4") from None
