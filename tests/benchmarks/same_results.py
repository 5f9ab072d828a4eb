"""Whether two versions of ambid say the same: runs the commands on a folder of data, and compares what they wrote.

Run as a script, with the Python of each version in turn:

    python tests/benchmarks/same_results.py run DATA --out before
    python tests/benchmarks/same_results.py run DATA --out after
    python tests/benchmarks/same_results.py compare before after

DATA holds ``cases/*`` (rig.toml, train.*, validate.*) and ``campaign`` (a folder per bias current). Numbers count as
equal up to 1e-9, relative; times are left out, and candidates of one score may stand in either order.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

TOLERANCE = 1e-9
LEFT_OUT = {"seconds"}


def jobs(data: Path) -> Iterator[tuple[str, list[str]]]:
    """Name and arguments of every command."""
    for case in sorted((data / "cases").glob("*/rig.toml")):
        rig, folder = str(case), case.parent
        train, validate = (sorted(map(str, folder.glob(f"{part}*"))) for part in ("train", "validate"))
        yield f"{folder.name}-identify", ["identify", rig, *train]
        yield f"{folder.name}-compare", ["compare", rig, *train, *validate]
        yield f"{folder.name}-diagnose", ["diagnose", rig, *train, *(["--validate", *validate] if validate else [])]
    campaign = data / "campaign"
    yield "campaign", ["campaign", str(campaign)]
    points = sorted(campaign.glob("*/rig.toml"))
    for rig in points:
        name, records = rig.parent.name, sorted(map(str, rig.parent.glob("prbs_*")))
        yield f"campaign-{name}-identify", ["identify", str(rig), *records]
        yield f"campaign-{name}-compare", ["compare", str(rig), *records]
        yield f"campaign-{name}-diagnose", ["diagnose", str(rig), records[0], "--validate", records[-1]]


def run(data: Path, out: Path, options: list[str]) -> None:
    """Run every command that is not there yet, one thread each, and keep its JSON."""
    out.mkdir(parents=True, exist_ok=True)
    program = [sys.executable, "-c", "from ambid.cli import main; main()"]
    for name, arguments in jobs(data):
        if (out / f"{name}.json").exists():
            continue
        command = [*program, *arguments, *options, "--quiet", "--json", str(out / f"{name}.json")]
        ended = subprocess.run(command, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}, check=False)
        print(f"{name}: exit {ended.returncode}", flush=True)


def numbers(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of JSON with the way to each."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if key not in LEFT_OUT:
                yield from numbers(entry, f"{where}/{key}")
    elif isinstance(value, list):
        for k, entry in enumerate(value):
            ranked = isinstance(entry, dict) and "effect" in entry
            if ranked:  # candidates of one score may stand in either order
                yield f"{where}/score {k}", entry["score"]
            yield from numbers(entry, f"{where}/{entry['effect'] if ranked else k}")
    else:
        yield where, value


def differences(before: Any, after: Any) -> list[tuple[float, str, Any, Any]]:
    """What differs, largest first; infinite where words or keys do."""
    old, new = dict(numbers(before)), dict(numbers(after))
    found = [(np.inf, key, old.get(key), new.get(key)) for key in old.keys() ^ new.keys()]
    for key in old.keys() & new.keys():
        a, b = old[key], new[key]
        if isinstance(a, float) and isinstance(b, float):
            found.append((abs(a - b) / max(abs(a), abs(b), 1e-300) if a != b else 0.0, key, a, b))
        elif a != b:
            found.append((np.inf, key, a, b))
    return sorted(found, key=lambda entry: -entry[0])


def in_short(before: Any, after: Any) -> str:
    """The verdicts, or the largest difference of a value of both in standard errors of the first version."""
    if "verdict" in before:
        named = [f"{own['verdict']} {', '.join(own['effects']) or '-'}" for own in (before, after)]
        return f"{named[0]} -> {named[1]}"
    old, new = (own.get("parameters") or {} for own in (before, after))
    off = [abs(new[k]["value"] - old[k]["value"]) / old[k]["std_error"] for k in old.keys() & new.keys()]
    return f"values within {max(off):.2g} standard errors" if off else "no values of both"


def compare(before: Path, after: Path) -> int:
    """Print the largest difference of every result; 1 if one is above the tolerance."""
    failed = 0
    for path in sorted(before.glob("*.json")):
        if not (after / path.name).exists():
            failed = 1
            print(f"{path.stem:40s} is missing in {after}")
            continue
        pairs = differences(*(json.loads((folder / path.name).read_text()) for folder in (before, after)))
        over = [entry for entry in pairs if entry[0] > TOLERANCE]
        failed |= bool(over)
        print(f"{path.stem:40s} {len(pairs):6d} numbers, largest difference {pairs[0][0] if pairs else 0.0:.2g}")
        for size, key, a, b in over[:5]:
            print(f"    {key}: {a!r} -> {b!r} ({size:.2g})")
        print(f"    {in_short(*(json.loads((folder / path.name).read_text()) for folder in (before, after)))}")
    return failed


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="action", required=True)
    running, comparing = parts.add_parser("run"), parts.add_parser("compare")
    running.add_argument("data", type=Path)
    running.add_argument("--out", type=Path, required=True)
    running.add_argument("--exact", action="store_true", help="take every value of the rig files for exact")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--without", nargs="*", default=[], help="keys that are left out, such as those of texts")
    given = parser.parse_args()
    if given.action == "run":
        run(given.data, given.out, ["--exact"] if given.exact else [])
    else:
        LEFT_OUT.update(given.without)
        sys.exit(compare(given.before, given.after))
