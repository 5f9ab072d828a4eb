"""Runs a command again and again in forked processes, and sends each a signal at another moment of its run.

A process of its own, in which everything is imported and nothing has been computed: a fork costs next to nothing, so
that hundreds of moments fit into a test. Reads a task as JSON on stdin, and writes what happened to stdout:

arguments of the command, its outputs, how many moments there are for each signal, whether a report is drawn, which
takes seconds, and the folder of the data of the demo's story.
"""

import importlib
import json
import os
import signal
import sys
import time
import traceback
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from ambid.cli import main, signals
from faults.files import is_writing, left_over, state, write_old
from undrawn import undraw

BEYOND = 1.05
"""Moments reach this far, in units of the time that a run takes."""
BRIEF = 5.0
"""Seconds below which imports are a large part of a run."""
ENDED = os.WEXITED | os.WNOHANG | os.WNOWAIT
"""Tell whether a process has ended, and leave it there."""
LOOKS = 2e-4
"""Seconds between looks at whether a command has begun to write."""


def launch(arguments):
    """Process number of the command in a fork, what it prints in the files `out` and `err`."""
    for stream, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    number = os.fork()
    if number:
        return number
    sys.argv = ["ambid", *arguments]
    code = 1
    try:
        main()
    except SystemExit as ended:
        code = ended.code
    except BaseException:
        traceback.print_exc()  # as the interpreter would, which this process does not come to
    finally:
        Path("modules").write_text("\n".join(sys.modules))
        sys.stderr.flush()
        os._exit(code)


def run(arguments, outputs, name="", moment=0.0, writing=False):
    """One run, with a signal if it is named, so long after it began, or began to write; what it left."""
    for path in outputs:
        write_old(path)
    begun, at = time.perf_counter(), time.time()
    number = launch(arguments)
    if name:
        while writing and not is_writing(outputs) and os.waitid(os.P_PID, number, ENDED) is None:
            time.sleep(LOOKS)
        time.sleep(max(0.0, (time.perf_counter() if writing else begun) + moment - time.perf_counter()))
        os.kill(number, signal.Signals[name])  # a process that has ended is there until it is waited for
    _, status = os.waitpid(number, 0)
    return {
        "signal": name,
        "seconds": time.perf_counter() - begun,
        "code": os.waitstatus_to_exitcode(status),
        "first": min(Path(path).stat().st_mtime for path in outputs) - at if not name else None,
        "files": {path: state(Path(path)) for path in outputs},
        "left_over": left_over(),
        "out": Path("out").read_text(),
        "err": Path("err").read_text(),
    }


def go(task):
    """An undisturbed run first, for what is imported and for the time that it takes; then those with signals.

    That of a brief command is run again without its imports, which those with signals have done.
    """
    arguments, outputs = task["arguments"], task["outputs"]
    if task["data"]:
        importlib.import_module("ambid.demo.story").DATA = Path(task["data"])
    if not task["drawn"]:
        undraw(pytest.MonkeyPatch())
    found = [run(arguments, outputs)]
    load(Path("modules").read_text().splitlines())
    if found[0]["seconds"] < BRIEF:
        found = [run(arguments, outputs)]
    if any(one["code"] for one in found):
        return found  # there is nothing to disturb
    first, last = found[0]["first"], found[0]["seconds"]
    return found + [
        run(arguments, outputs, name, *moment)
        for name, count in task["moments"].items()
        for moment in spread(count, BEYOND * last, BEYOND * (last - first))
    ]


def spread(count, whole, writing):
    """So many moments: half of them over the whole run, half of them from when its files begin to be written.

    Those do not go by the clock of an undisturbed run, which a loaded machine leaves behind, nor does the first of
    several over the whole run, which comes at once; a single one comes in the middle.
    """
    early, late = count - count // 2, count // 2
    begin = 0.5 if early == 1 else 0.0
    return [(whole * (k + begin) / early, False) for k in range(early)] + [
        (writing * (k + 0.5) / late, True) for k in range(late)
    ]


def load(modules):
    """Import what the command imports, and find the fonts of pictures: its forks need not."""
    for name in modules:
        with suppress(ImportError):
            importlib.import_module(name)
    Figure(layout="constrained").savefig(BytesIO())


if __name__ == "__main__":
    signals.watch()
    shown = os.dup(1)  # the numbers 1 and 2 are the command's
    os.write(shown, json.dumps(go(json.load(sys.stdin))).encode())
