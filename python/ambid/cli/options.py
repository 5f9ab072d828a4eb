"""Arguments and options that several commands have, and how their texts are read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

import ambid
from ambid.cli.noted import begin_findings
from ambid.errors import InputError, printable

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
