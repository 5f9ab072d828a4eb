"""How often is the truth in the reported set? Every effect, three sizes, many seeds, from an independent simulator.

    python tests/benchmarks/rates.py --seeds 20 --out rates.jsonl
    python tests/benchmarks/rates.py --out rates.jsonl --report confusion.png

Runs go on where the file ends. No part of it is a test: it takes hours. What has no name is not tried barely visible:
it is then too weak for its shape to show, and nothing can be said of it but that all is well. The same holds of what
acts as more noise and does not repeat: a record that shows its noise by itself has nothing to tell it by.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from ambid.diagnosis import diagnose
from ambid.effects import slips
from hidden.experiment import experiment
from hidden.physics import CATALOGUE, OUTSIDE

NOISE_LIKE = {"command_quantisation"}
SIZES = ("barely", "clear", "large")
PAIRS = (
    ("loop_delay", "seal_forces"),
    ("bending_mode_shift", "amplifier_bandwidth"),
    ("sensor_gain_error", "back_emf"),
    ("coupling_stiffness", "sampling_skew"),
    ("force_nonlinearity", "loop_delay"),
    ("eddy_currents", "rotor_inertia_error"),
    ("sensor_lag", "axis_cross_coupling"),
    ("foundation_resonance", "sensor_misalignment"),
    ("periodic_disturbance", "seal_forces"),
    ("flux_saturation", "rotor_bending_mode"),
)
Job = tuple[tuple[str, ...], str, int, str]


def jobs(seeds: range, sizes: Iterable[str], kinds: Iterable[str], names: list[str]) -> list[Job]:
    """All runs, seed by seed, so that an interrupted benchmark has some of everything."""
    found: list[Job] = []
    for seed in seeds:
        for kind in kinds:
            found.append(((), "clear", seed, kind))
            found += [((name,), size, seed, kind) for name in CATALOGUE for size in sizes]
            found += [((name,), size, seed, kind) for name in OUTSIDE for size in sizes if size != "barely"]
            found += [(pair, size, seed, kind) for pair in PAIRS for size in sizes if size != "barely"]
    return [job for job in found if not names or set(names) & _labels(job)]


def _labels(job: Job) -> set[str]:
    return {*job[0], ("nothing", "one", "pairs")[len(job[0])]}


def run(job: Job) -> dict[str, Any]:
    """One experiment and its diagnosis."""
    hidden, size, seed, kind = job
    line: dict[str, Any] = {"hidden": list(hidden), "size": size, "seed": seed, "kind": kind}
    begun = time.perf_counter()
    try:
        rig, train, validate, truth = experiment(hidden or None, size, seed, kind=kind)
        line["score"] = truth.score
        line["truth"] = list(truth.effects)
        found = diagnose(rig, train, validate=validate)
    except Exception as error:
        return {**line, "verdict": "error", "error": f"{type(error).__name__}: {error}"}
    first = found.history[0] if found.history else None
    return {
        **line,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "sets": found.ambiguous_sets,
        "misfits": [round(step.misfit, 4) for step in found.history],
        "validation": [step.validation_misfit and round(step.validation_misfit, 4) for step in found.history],
        "ranking": [[c.effect.name, round(c.score, 1)] for c in first.ranking.candidates[:4]] if first else [],
        "notes": list(found.notes),
        "seconds": round(found.seconds, 2),
        "wall": round(time.perf_counter() - begun, 2),
    }


def named(line: dict[str, Any]) -> set[str]:
    """Everything that the diagnosis names."""
    return {*line.get("effects", ()), *(name for names in line.get("sets", ()) for name in names)}


def is_right(line: dict[str, Any]) -> bool:
    """Whether the truth is in what is reported: all of it named, or nothing named where nothing has a name."""
    hidden = line.get("truth", line["hidden"])
    if not hidden:
        return line["verdict"] == "adequate"
    if not set(hidden) <= set(CATALOGUE):
        allowed = {"none_of_the_candidates"} | ({"adequate"} if set(hidden) <= NOISE_LIKE else set())
        return line["verdict"] in allowed
    return line["verdict"] in ("explained", "ambiguous") and set(hidden) <= named(line)


def report(lines: list[dict[str, Any]], picture: Path | None) -> None:
    """Tables of the rates, and the confusion matrix."""
    groups: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        groups[" + ".join(line["hidden"]) or "nothing"][line["size"]].append(line)
    print(f"{'hidden':44s}" + "".join(f"{size:>14s}" for size in SIZES))
    for name, by_size in groups.items():
        cells = [f"{sum(map(is_right, by_size[s]))}/{len(by_size[s])}" if s in by_size else "" for s in SIZES]
        print(f"{name:44s}" + "".join(f"{cell:>14s}" for cell in cells))
    for title, chosen in {
        "catalogue": [x for x in lines if len(x["hidden"]) == 1 and x["hidden"][0] in CATALOGUE],
        "outside": [x for x in lines if len(x["hidden"]) == 1 and x["hidden"][0] in OUTSIDE],
        "pairs": [x for x in lines if len(x["hidden"]) > 1],
        "nothing": [x for x in lines if not x["hidden"]],
    }.items():
        for size in (*SIZES, None):
            own = [x for x in chosen if size in (None, x["size"])]
            if own:
                rate = sum(map(is_right, own)) / len(own)
                alone = sum(is_right(x) and x["verdict"] == "explained" for x in own) / len(own)
                runs = f"{title:12s} {size or 'all':8s} {len(own):5d} runs"
                print(f"{runs}: right {100 * rate:5.1f} %, alone {100 * alone:5.1f} %")
    seconds = sorted(x["seconds"] for x in lines if "seconds" in x)
    if seconds:
        print(f"seconds: median {seconds[len(seconds) // 2]:.1f}, largest {seconds[-1]:.1f}")
    if picture is not None:
        draw(lines, picture)


def draw(lines: list[dict[str, Any]], path: Path) -> None:
    """Hidden effect by what was reported first, share of the runs."""
    from matplotlib.figure import Figure

    singles = [x for x in lines if len(x["hidden"]) <= 1]
    rows = ["nothing", *CATALOGUE, *OUTSIDE]
    columns = [
        *CATALOGUE,
        *(slip.name for slip in slips.EFFECTS),
        "adequate",
        "none_of_the_candidates",
        "not_informative",
        "error",
    ]
    figure = Figure(figsize=(15, 15), layout="constrained")
    ax = figure.add_subplot()
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for line in singles:
        hidden = line["hidden"][0] if line["hidden"] else "nothing"
        reported = named(line) or {line["verdict"]}
        for name in reported:
            counts[hidden][name] += 1
        counts[hidden]["runs"] += 1
    table = [[counts[row][column] / max(counts[row]["runs"], 1) for column in columns] for row in rows]
    ax.imshow(table, cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    for i, row in enumerate(table):
        for j, share in enumerate(row):
            if share > 0.0:
                ax.text(j, i, f"{100 * share:.0f}", ha="center", va="center", color="w" if share > 0.5 else "k", size=8)
    ax.set_xticks(range(len(columns)), columns, rotation=90)
    ax.set_yticks(range(len(rows)), rows)
    ax.set_xlabel("named in the result, % of the runs (several may be named)")
    ax.set_ylabel("hidden")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run what is missing, then report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--sizes", nargs="*", default=SIZES)
    parser.add_argument("--kinds", nargs="*", default=["analog"])
    parser.add_argument("--effects", nargs="*", default=[], help="names, 'pairs', 'nothing'; default: everything")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--report", type=Path)
    parser.add_argument("--wrong", action="store_true", help="list what went wrong")
    options = parser.parse_args()
    lines = [json.loads(text) for text in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {(tuple(x["hidden"]), x["size"], x["seed"], x["kind"]) for x in lines}
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    todo = [job for job in jobs(seeds, options.sizes, options.kinds, options.effects) if job not in done]
    with ProcessPoolExecutor(options.workers) as pool, options.out.open("a") as out:
        for future in as_completed([pool.submit(run, job) for job in todo]):
            lines.append(future.result())
            out.write(json.dumps(lines[-1]) + "\n")
            out.flush()
    report(lines, options.report)
    if options.wrong:
        for x in lines:
            if not is_right(x):
                shown = ("kind", "hidden", "size", "seed", "verdict", "effects", "sets", "misfits", "ranking", "error")
                print(*(x.get(key, "") for key in shown))


if __name__ == "__main__":
    main()
