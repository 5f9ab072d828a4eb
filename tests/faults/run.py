"""Signals by the hundred to every command that writes: `python tests/faults/run.py --kills 200 --signals 100`.

A line for each command and signal: runs, in how many of them the files were all old, some new, all new, or broken,
how many temporary files were left, and the exit codes. Ends with exit 1 where a promise is not kept.
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from faults.jobs import JOBS, ONE_BY_ONE, STORY, disturbed, prepare
from faults.promises import check

COMMANDS = {**JOBS, "demo": STORY}
ROW = "{:18s} {:8s} {:>5s} {:>8s} {:>9s} {:>8s} {:>7s} {:>10s}  {}"
HEAD = ("command", "signal", "runs", "all old", "some new", "all new", "broken", "left over", "exit codes")


def line(job, name, found):
    """What runs of a command with one signal left."""
    states = [set(one["files"].values()) for one in found]
    broken = sum("broken" in own for own in states)
    old, new = sum(own == {"old"} for own in states), sum(own == {"new"} for own in states)
    left = sum(one["left_over"] for one in found)
    codes = ", ".join(f"{code}: {count}" for code, count in sorted(Counter(one["code"] for one in found).items()))
    counts = (len(found), old, len(found) - old - new - broken, new, broken, left)
    return ROW.format(job, name or "none", *map(str, counts), codes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", nargs="*", default=list(COMMANDS), choices=COMMANDS)
    parser.add_argument("--kills", type=int, default=200, help="Moments of SIGKILL.")
    parser.add_argument("--signals", type=int, default=100, help="Moments of SIGINT, and of SIGTERM.")
    given = parser.parse_args()
    moments = {"SIGKILL": given.kills, "SIGINT": given.signals, "SIGTERM": given.signals}
    kept, begun = True, time.monotonic()
    print(ROW.format(*HEAD))
    for job in given.jobs:
        with tempfile.TemporaryDirectory() as folder:
            found = disturbed(prepare(Path(folder)), COMMANDS[job], moments)
        for name in ("", *moments):
            print(line(job, name, [one for one in found if one["signal"] == name]), flush=True)
        try:
            check(found, all_or_none=job not in ONE_BY_ONE)
        except AssertionError as error:
            kept = False
            print(f"{job}: {error}", flush=True)
    print(f"{time.monotonic() - begun:.0f} s")
    sys.exit(not kept)


if __name__ == "__main__":
    main()
