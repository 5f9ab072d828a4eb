"""What commands leave: which files may be written is known before the work, and all are written before any print.

What a result says is to be done next is printed with the command that does it: rooms below do not know these.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any

import ambid
from ambid.cli.files import count_of, with_findings
from ambid.cli.signals import begin_results, came, stopped
from ambid.errors import AmbidError, InputError, printable
from ambid.findings import Finding
from ambid.writing import is_device, require_writable, whole_file

PRINTED = Path("-")
"""In place of a file for JSON: stdout."""

STOPPED = "stopped"
"""Key of JSON that says whether a signal came before all was done."""
ALL_OF_IT = "when the result above was finished; all that was asked for is written"
ONLY_THESE = "twice while files were written: of the result above, which is finished, not all is written"

DIAGNOSE = "ambid diagnose RIG RECORD"
COMMANDS = {
    "deflection_left_out": "ambid static-load RIG LOADS --deflection",
    "next_validate": "ambid compare RIG RECORD --model MODEL",
    "next_diagnose": DIAGNOSE,
    "next_excite_and_diagnose": DIAGNOSE,
    "next_fit_force_law": f"{DIAGNOSE} --effects {{effect}}",
    "next_lower_tolerance": f"{DIAGNOSE} --tolerance {{tolerance:.2f}}",
    "next_judge_residual": f"{DIAGNOSE} --tolerance J",
    "next_simulate_experiments": f"{DIAGNOSE} --next",
    "next_mend": "ambid design RIG",
    "next_begin_anew": "ambid campaign {campaign}",
    "next_validate_models": "ambid compare RIG RECORD",
    "next_diagnose_kind": "ambid diagnose {rig} {record}[ --validate {validate}]",
}
"""By code of what is to be done, or of what is found, with values of its finding; a name in capitals is an argument of
one's own, and what stands in square brackets is left out where its value is not known."""

Files = Mapping[str, Path | Sequence[Path] | None]
"""By option or argument; None where it was not given."""


def require_outputs(inputs: Files, outputs: Files, replaced: Sequence[str | Path] = ()) -> None:
    """Refuse outputs before any work is done.

    Parameters
    ----------
    inputs, outputs : mapping
        What the command reads and writes.
    replaced : sequence of str or Path
        Options whose file may be a rig or a record that is there; and files that look like one, and are none.

    Raises
    ------
    InputError
        If an output is an input too, under whatever name, or another output, or is in no folder, or would replace a rig
        file or a record.
    OutputError
        If there is no permission to write one.
    """
    read, written = _each(inputs), _each(outputs)
    for (option, path), (other, its) in [*product(written, read), *combinations(written, 2)]:
        if _is_same(path, its):
            raise InputError(f"{option} {path}: the same file as {other} {its}; give another file")
    for option, path in written:
        require_writable(path)
        if option not in replaced and path not in replaced and path.is_file():
            _require_own_kind(option, path)


def require_new(option: str, path: Path, force: bool) -> None:
    """Refuse to replace a file that is there, but with ``--force``."""
    if path.exists() and not force:
        raise InputError(f"{option} {path}: is there already; give another file, or replace it with --force")


def conclude(
    result: object,
    data: dict[str, Any] | Callable[[], dict[str, Any]],
    json_file: Path | None,
    quiet: bool,
    *writers: Callable[[], Sequence[Path]],
    findings: Sequence[Finding] = (),
    is_stopped: bool = False,
) -> None:
    """Write all files, then print the result; a file that cannot be written does not keep the rest from it.

    Parameters
    ----------
    result : object
        What is printed.
    data : dict or callable
        For ``--json``, strict JSON; what makes it where that takes long, and is asked only where JSON is.
    json_file : Path, optional
    quiet : bool
        Whether nothing is to be printed but JSON that was asked for; JSON is always printed alone.
    *writers : callable
        Write further files, and return those to be named.
    findings : sequence of Finding
        Of the command, for JSON, beside those of its result.
    is_stopped : bool
        Whether the result itself says that a signal has stopped it; of one that came later it is said here, and in
        JSON that has the key `STOPPED`.

    Raises
    ------
    AmbidError
        The first one of a writer, in the end.
    KeyboardInterrupt
        If a second signal ended the writing.
    """
    begin_results()
    made: dict[str, Any] = {}
    written: list[Path] = []
    errors: list[AmbidError] = []
    is_cut = False
    try:
        if json_file is not None:
            made = with_findings(data() if callable(data) else data, findings)
        for write in (lambda: _write_json(made, json_file), *writers):
            try:
                written += write()
            except AmbidError as error:
                errors.append(error)
        if came() and made.get(STOPPED) is False:
            made[STOPPED] = True
            _write_json(made, json_file)
    except KeyboardInterrupt:  # the second: what is finished is printed all the same
        is_cut = True
    if not quiet and json_file != PRINTED:
        print(printable(str(result)))
        for path in written:
            print(printable(f"written: {path}"))
        if is_cut or came() and not is_stopped:
            print(f"{stopped()} {ONLY_THESE if is_cut else ALL_OF_IT}")
    if json_file == PRINTED and made:
        print(_as_json(made), end="")
    if is_cut:
        raise KeyboardInterrupt
    for further in errors[1:]:
        print(f"error: {further}", file=sys.stderr)
    if errors:
        raise errors[0]


def saved(result: ambid.Estimate | ambid.Diagnosis, path: Path | None) -> Sequence[Path]:
    """Write the model where ``--save`` says."""
    if path is None:
        return ()
    result.save(path)
    return [path]


def drawn(
    model: ambid.Model, records: Sequence[ambid.Record | ambid.FrequencyResponse], path: Path | None
) -> Sequence[Path]:
    """Draw measured against simulated where ``--plot`` says."""
    return () if path is None else ambid.plot.save_comparison(ambid.compare(model, records), path)


def reported(result: ambid.Diagnosis, paths: Sequence[Path]) -> Sequence[Path]:
    """Write the report where ``--report`` and ``--pdf`` say."""
    if paths:
        ambid.report.write_report(result, *paths)
    return paths


def pictures(path: Path | None, records: Sequence[Path]) -> Sequence[Path]:
    """Where `drawn` draws these records."""
    if path is None:
        return ()
    ambid.plot.check_format(path)
    return ambid.plot.picture_files(path, count_of(records))


def _each(files: Files) -> list[tuple[str, Path]]:
    many = ((option, [path] if isinstance(path, Path) else path or ()) for option, path in files.items())
    return [(option, path) for option, paths in many for path in paths if path != PRINTED]


def _is_same(path: Path, other: Path) -> bool:
    """Whether two paths lead to one file, by links or by case too; a device may be written twice."""
    if path.exists() and other.exists():
        return path.samefile(other) and not is_device(path)
    return os.path.realpath(path).casefold() == os.path.realpath(other).casefold()


def _require_own_kind(option: str, path: Path) -> None:
    from ambid.record.readers import SUFFIXES  # not at the top: --help need not open that room
    from ambid.record.universal import UNIVERSAL

    kind = {".toml": "a rig file"} | dict.fromkeys((*SUFFIXES, *UNIVERSAL), "a record")
    suffix = Path(os.path.realpath(path)).suffix.lower()
    if suffix in kind:
        raise InputError(f"{option} {path}: would replace {kind[suffix]}; give another file, or delete that one first")


def _as_json(data: dict[str, Any]) -> str:
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


def _write_json(data: dict[str, Any], path: Path | None) -> Sequence[Path]:
    if path is not None and path != PRINTED:
        with whole_file(path) as stream:
            stream.write(_as_json(data).encode())
    return ()


def command_of(steps: Iterable[Finding]) -> str:
    """Of the first of these that a command does; empty where none does."""
    step = next((step for step in steps if step.code in COMMANDS), None)
    if step is None:
        return ""
    known = {
        name: value if isinstance(value, float) else shlex.quote(str(value)) for name, value in step.values.items()
    }
    text = re.sub(
        r"\[([^{]*\{(\w+)\})\]", lambda part: "" if step.values[part[2]] is None else part[1], COMMANDS[step.code]
    )
    return text.format_map(known)


def with_command(text: str, command: str) -> str:
    """What is printed, with the command where there is one."""
    return f"{text}\n  {command}" if command else text
