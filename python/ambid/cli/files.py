"""Files that commands read, and what is found in them: at once on stderr, and among the findings of a JSON."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import ambid
from ambid.errors import InputError, UnstableLoopError, UnstableStartError, printable
from ambid.findings import Finding, Kind, Where

NO_RECORD = "no record follows; name the records of this operating point after its rig file"

MODEL_OF_ANOTHER_RIG = Kind(
    "model_of_another_rig",
    "warning",
    "the model was saved of another rig: {differences}[; and {further} more keys]; its parameters and effects are "
    "taken on {rig}",
    "give the rig that it was fitted on, unless that is meant",
)

ERRORS_NOT_TAKEN = Kind(
    "model_errors_not_taken",
    "warning",
    "the model was saved with errors of values of the rig file that are exact here: {errors}; without them it does not "
    "respond as it did",
    "take it with the tolerances of the rig file, or fit it again",
)

MOST_KEYS = 5
"""Keys of another rig that are listed one by one."""
NOMINAL = ("force_current", "force_displacement", "actuator.time_constant")
"""Keys that a saved model has values of its own for: they matter least, and are listed last."""

_noted: list[Finding] = []


def load_rig(path: Path, exact: bool) -> ambid.Rig:
    """The rig of a file; every value of it exact where that is asked for."""
    rig = ambid.Rig.load(path)
    return rig.exact() if exact else rig


def load_model(rig: ambid.Rig, path: Path | None) -> ambid.Model:
    """The rig's nominal model, or a saved one on this rig; where it was saved of another one, that is noted."""
    if path is None:
        return ambid.Model(rig)
    model = ambid.Model.load(path, rig)
    for finding in (*_of_another_rig(rig, path), *_of_errors(model, path)):
        note(finding)
    return model


def _of_errors(model: ambid.Model, path: Path) -> list[Finding]:
    """Of a model that has errors of the rig file which are exact here."""
    from ambid.model.file import errors_of_model  # not at the top: --help need not open that room

    lost = {name: value for name, value in errors_of_model(path).items() if name not in model.names}
    if not lost:
        return []
    errors = [f"{name} {value:.3g}" for name, value in sorted(lost.items(), key=lambda own: own[0])]
    return [ERRORS_NOT_TAKEN(Where(file=str(path)), errors=errors)]


def _of_another_rig(rig: ambid.Rig, path: Path) -> list[Finding]:
    """Of a model that was saved of a rig of other keys than this one: which, and where it is used now.

    The operating points that it was fitted at beside its rig are its own.
    """
    from ambid.model.file import rigs_of_model  # not at the top: --help need not open these rooms
    from ambid.rig.notes import differences

    apart = [differences(own, rig) for own in rigs_of_model(path)]
    if not all(apart):
        return []
    first = sorted(apart[0], key=lambda own: own[0].endswith(NOMINAL))
    return [
        MODEL_OF_ANOTHER_RIG(
            Where(file=str(path)),
            differences={key: {"saved": there, "given": here} for key, there, here in first[:MOST_KEYS]},
            further=max(0, len(first) - MOST_KEYS) or None,
            rig=str(rig.path or rig.name),
        )
    ]


@contextmanager
def naming_unstable(rig: Path, start: ambid.Model, model: Path | None = None) -> Iterator[None]:
    """Say of which file the loop is unstable that a job needs, and what to do.

    Parameters
    ----------
    rig : Path
    start : Model
        That the job simulates.
    model : Path, optional
        Where it was read from, if not from the rig.
    """
    try:
        yield
    except UnstableLoopError as error:
        if isinstance(error, UnstableStartError):
            raise UnstableStartError(f"{error}{_held_by(start)}") from None
        if start.is_stable:
            raise  # as a fit reports it, with what it has tried; or a response that leaves all bounds
        pole = start.poles()[0]
        why = f"a pole at {abs(pole.imag) / (2.0 * np.pi):.3g} Hz grows with {pole.real:.3g} 1/s"
        if not ambid.Model(start.rig).is_stable:
            problem = f"{rig}: the nominal loop is unstable ({why}); `ambid check {shlex.quote(str(rig))}` shows why"
            problem += f".{held}" if (held := _held_by(start)) else ""
        else:
            beside = ", ".join(effect.name for effect in start.effects)
            problem = f"{model or rig}: the loop is unstable" + (f" with {beside}" if beside else "") + f" ({why})"
            problem += "; give it another value" if beside else "; identify first, or give another model"
        raise UnstableLoopError(problem) from None


def _held_by(start: ambid.Model) -> str:
    """Which effects make an unstable loop stable, and where they are tried; empty where none does."""
    from ambid.diagnosis import holders  # not at the top: it is needed for errors alone

    found = holders(start)
    return f" With {', '.join(found)} in the model it is stable: `ambid diagnose` tries these." if found else ""


def require_first_point(rig: Path, paths: Sequence[Path]) -> None:
    """Refuse to fit the parameters of an operating point that no record is from.

    Raises
    ------
    InputError
        If another rig file comes before the first record.
    """
    if paths and paths[0].suffix.lower() == ".toml":
        raise InputError(
            f"{rig}: {NO_RECORD}, before {paths[0]}; leave this one out if there are none, and begin with {paths[0]}"
        )


def count_of(paths: Sequence[Path]) -> int:
    """How many of these are records, and no rig files."""
    return sum(path.suffix.lower() != ".toml" for path in paths)


def map_options(columns: Sequence[str]) -> list[str]:
    """Options of ``--map``, each ``CHANNEL=COLUMN`` or a text file of these."""
    options: list[str] = []
    for text in columns:
        if "=" in text:
            options.append(text)
            continue
        if not Path(text).is_file():
            raise InputError(
                f"--map {text}: there is no such file; expected CHANNEL=COLUMN or CHANNEL=COLUMN:FACTOR, such as "
                "y.A_zeta=ch3:1e-6, or a text file of such arguments"
            )
        options += ambid.ChannelMap.options_of(text)
    return options


def load_records(
    rig: ambid.Rig,
    paths: list[Path],
    period: int | None,
    columns: list[str],
    sample_rate: float | None,
    allow: Sequence[str] = (),
) -> list[ambid.Record | ambid.FrequencyResponse]:
    """Records and frequency responses of a rig; `columns` are options as `map_options` reads them.

    A rig file among them opens another operating point of the machine: the records after it were recorded there. Its
    values are exact where those of the rig are.
    """
    if sample_rate is not None and not (np.isfinite(sample_rate) and sample_rate > 0.0):
        raise InputError(f"--sample-rate {sample_rate:g}: expected a positive number of Hz")
    mapping = ambid.ChannelMap.parse(map_options(columns)) if columns else None
    found: list[ambid.Record | ambid.FrequencyResponse] = []
    point = rig
    for path, after in pairwise([*paths, Path()]):
        if path.suffix.lower() == ".toml":
            point = load_rig(path, rig.is_exact)
            if after.suffix.lower() in (".toml", ""):
                raise InputError(f"{path}: {NO_RECORD}")
            continue
        record = ambid.load_measurement(
            path, point, period=period, mapping=mapping, sample_rate=sample_rate, allow=allow
        )
        found.append(record if point is rig else record.at(point))
    return found


def begin_findings() -> None:
    """Forget the findings of a command before, where several run in one process."""
    _noted.clear()


def note(finding: Finding) -> None:
    """Say something once."""
    if finding not in _noted:
        _noted.append(finding)
        print(printable(f"{finding.severity}: {finding.line()}"), file=sys.stderr)


def with_findings(data: Mapping[str, Any], more: Sequence[Finding] = ()) -> dict[str, Any]:
    """Data for JSON with the findings of its parts, of the command beside its result, and of its inputs.

    Parameters
    ----------
    data : mapping
        A result's own, whose findings stand under ``findings``, or under those of its parts.
    more : sequence of Finding
        Of the command, beside those of its result.
    """
    found = list(data["findings"]) if "findings" in data else _of_parts(data)
    further = [finding for finding in (*more, *_noted) if finding.as_dict() not in found]
    found += [finding.as_dict() for finding in further]
    notes = [*data.get("notes", []), *(finding.line() for finding in further)]
    return {**data, "findings": found} | ({"notes": notes} if notes or "notes" in data else {})


def _of_parts(value: Any) -> list[Any]:
    """The findings of what is nested in the data, each once."""
    if isinstance(value, Mapping):
        parts = [*value.get("findings", []), *(of for entry in value.values() for of in _of_parts(entry))]
    elif isinstance(value, list | tuple):
        parts = [of for entry in value for of in _of_parts(entry)]
    else:
        return []
    return [part for k, part in enumerate(parts) if part not in parts[:k]]
