"""A process that runs inputs one after the other, and says how each ended; a crash of it is that of its input."""

import contextlib
import faulthandler
import io
import json
import os
import re
import resource
import signal
import sys
import time
import traceback
import unicodedata
import warnings
from pathlib import Path
from threading import Timer

import ambid.cli
from fuzz.inputs import Input, make

ROOM = 1 << 30
"""Bytes that an input may take beyond what the process has after its first runs."""
LONGEST = 6000
"""Characters on stderr: a screen, and the file's name again."""
SERVES = "http://127.0.0.1:"
"""What the workbench says when it waits for a browser; from then on it ends at Ctrl-C alone."""
SERVED = 0.1
"""Seconds until that comes."""
GIVEN = {".toml", ".csv", ".mat", ".h5", ".parquet", ".tdms", ".uff"}
"""Suffixes of rigs and records, of which nothing may be lost."""


def main() -> None:
    """Read numbers of inputs from stdin, a line each; answer each with a line of JSON on stdout."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background does not hear it
    seed, bases, folder = int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    folder.mkdir(parents=True, exist_ok=True)
    for words in (
        ["check", "rig.toml", "run.csv"],
        ["identify", "rig.toml", "run.mat"],
        ["compare", "rig.toml", "run.h5"],
    ):
        os.chdir(bases)
        _run([*words, "--json", str(folder / "first.json")])
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + ROOM, taken + ROOM))
    for line in sys.stdin:
        made = make(seed, int(line), bases, folder / "files")
        os.chdir(folder / "files")
        begun = time.monotonic()
        outcome, detail = judge(made)
        answers.write(json.dumps([made.kind, outcome, detail, time.monotonic() - begun, _resident()]) + "\n")
        answers.flush()


def _resident() -> int:
    """Largest resident size so far [kB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


class _Out(io.StringIO):
    """A terminal with somebody who ends the workbench as soon as it serves."""

    def write(self, text: str) -> int:
        if text.startswith(SERVES):
            Timer(SERVED, os.kill, (os.getpid(), signal.SIGINT)).start()
        return super().write(text)


def _given() -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in Path().rglob("*") if path.suffix in GIVEN and path.is_file()}


def _run(words: list[str]) -> tuple[int, str, str]:
    out, err = _Out(), io.StringIO()
    sys.argv = ["ambid", *words]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            ambid.cli.main()
            code = 0
        except SystemExit as exit_:
            code = exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
    return code, out.getvalue(), err.getvalue()


def judge(made: Input) -> tuple[str, str]:
    """How a run of the command ends: ``exit`` and its code, or what is wrong with it."""
    before = _given()
    try:
        code, out, err = _run(made.words)
    except BaseException as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        own = [f for f in traceback.extract_tb(error.__traceback__) if "/ambid/" in f.filename][-1:]
        place = " < ".join(f"{Path(f.filename).name}:{f.lineno}" for f in [last, *own])
        return "traceback", f"{type(error).__name__} at {place}: {str(error)[:200]}"
    said, named = out + err, {word for word in made.words if Path(word).suffix} | {made.damaged}
    if "Traceback" in said or "panicked" in said:
        return "traceback", said[-300:]
    if code not in (0, 1, 2) and not (code == 130 and SERVES in out):
        return "exit code", f"{code}: {said[:200]}"
    if code and not said.strip():
        return "silent", f"exit {code}"
    of_model = "the model is singular", "at which the rotor is known"
    if (
        code == 2
        and made.damaged
        and not any(text in err for text in of_model)
        and err.startswith("error:")
        and not (named & set(re.split(r"[^\w.]+", err)))
    ):
        return "unnamed", err[:300]
    if len(err) > LONGEST:
        return "endless", f"{len(err)} characters: {err[:100]}"
    steering = next((c for c in said if c not in "\n\t" and unicodedata.category(c) in ("Cc", "Cf", "Cs")), None)
    if steering:
        return "steering", f"{steering!r} in {said[:200]!r}"
    after = _given()
    lost = [path for path, content in before.items() if after.get(path) != content]
    if lost and "--force" not in made.words:
        return "lost", f"{lost[0]}: {said[:200]}"
    written = Path("out.json")
    if written.is_file():
        try:
            json.loads(written.read_text(), parse_constant=_refuse)
        except ValueError as error:
            return "not finite", str(error)
    return f"exit {code}", err.strip()[:200] if code else ""


def _refuse(word: str) -> None:
    raise ValueError(f"{word} in the result")


if __name__ == "__main__":
    main()
