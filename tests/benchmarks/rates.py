"""How often is the truth in the reported set? Every effect, three sizes, many seeds, from an independent simulator.

    python tests/benchmarks/rates.py --bench compressor --seeds 20 --out rates.jsonl
    python tests/benchmarks/rates.py --out rates.jsonl --report --picture confusion.png --table rates.md

Runs go on where the file ends. No part of it is a test: it takes hours. Hidden are one, two and three effects of the
catalogue, physics that the catalogue never had (`outside`), and effects that are taken out of the catalogue for the
run, with those that look like them (`removed`): the last two have to end in `none_of_the_candidates`.

An effect is "barely" there, "clear" or "large" where it should raise J of a record of that machine by 30, 1e4 and 1e6
over its noise, after the base parameters took what they can (`hidden/sizes.py`): with the 25 000 to 41 000 degrees of
freedom here, a clear one alone lifts J/dof from 1 to between 1.2 and 1.4. Where several are hidden, each is of that
size. What has no name is not tried barely visible: it is then too weak for its shape to show, and nothing can be said
of it but that all is well. The same holds of what acts as more noise and does not repeat: a record that shows its noise
by itself has nothing to show it by.
"""

import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import ambid
from ambid import diagnose
from ambid.effects import channels, slips
from benchmarks.grid import aligned, markdown, options, rate_text, read_rows, run_all
from hidden.experiment import KINDS, experiment
from hidden.physics import CATALOGUE, OUTSIDE

BENCHES = {"bench": "analog", "small": "other_rotor", "compressor": "compressor"}
"""Kind of experiment on each machine."""
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
TRIPLES = (
    ("loop_delay", "seal_forces", "sensor_gain_error"),
    ("bending_mode_shift", "amplifier_bandwidth", "axis_cross_coupling"),
    ("foundation_resonance", "back_emf", "sensor_lag"),
    ("force_nonlinearity", "coupling_stiffness", "periodic_disturbance"),
    ("rotor_inertia_error", "eddy_currents", "sensor_misalignment"),
)
REMOVED: dict[str, tuple[str, ...]] = {
    "rotor_bending_mode": (),
    "bending_mode_shift": ("rotor_inertia_error",),
    "seal_forces": ("coupling_stiffness",),
    "foundation_resonance": (),
    "force_nonlinearity": ("flux_saturation",),
    "magnetic_hysteresis": (),
    "axis_cross_coupling": ("sensor_misalignment",),
    "amplifier_voltage_limit": (),
    "loop_delay": ("sensor_lag", "amplifier_bandwidth", "eddy_currents", "sampling_skew"),
    "sensor_gain_error": ("sensor_position_error",),
    "back_emf": ("controller_gain_error",),
}
"""Effects that are taken out of the catalogue, and what looks like them and goes too."""
Job = tuple[tuple[str, ...], str, int, str, bool]
"""Hidden effects, size, seed, kind of experiment, and whether the effects are taken out of the catalogue."""


def jobs(seeds: range, sizes: Iterable[str], kinds: Iterable[str], names: list[str]) -> list[Job]:
    """All runs, seed by seed, so that an interrupted benchmark has some of everything."""
    found: list[Job] = []
    seen = [size for size in sizes if size != "barely"]
    for seed in seeds:
        for kind in kinds:
            found.append(((), "clear", seed, kind, False))
            found += [((name,), size, seed, kind, False) for name in CATALOGUE for size in sizes]
            found += [((name,), size, seed, kind, False) for name in OUTSIDE for size in seen]
            found += [(several, size, seed, kind, False) for several in (*PAIRS, *TRIPLES) for size in seen]
            found += [((name,), size, seed, kind, True) for name in REMOVED for size in seen]
    return [job for job in found if not names or set(names) & {*job[0], group(job[0], job[4])}]


def group(hidden: Iterable[str], is_removed: bool) -> str:
    """What kind of hidden physics it is."""
    names = tuple(hidden)
    if is_removed:
        return "removed"
    if len(names) == 1:
        return "one" if names[0] in CATALOGUE else "outside"
    return {0: "nothing", 2: "pairs", 3: "triples"}[len(names)]


GROUPS = ("nothing", "one", "pairs", "triples", "outside", "removed")


def run(hidden: tuple[str, ...], size: str, seed: int, kind: str, is_removed: bool) -> dict[str, Any]:
    """One experiment and its diagnosis."""
    line: dict[str, Any] = {"hidden": list(hidden), "size": size, "seed": seed, "kind": kind, "removed": is_removed}
    gone = {other for name in hidden for other in (name, *REMOVED[name])} if is_removed else set()
    catalogue = [effect for effect in ambid.CATALOGUE if effect.name not in gone]
    begun = time.perf_counter()
    try:
        rig, train, validate, truth = experiment(hidden or None, size, seed, kind=kind)
        line["score"] = truth.score
        line["truth"] = list(truth.effects)
        found = diagnose(rig, train, validate=validate, catalogue=catalogue)
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
    if line.get("removed"):
        return line["verdict"] == "none_of_the_candidates"
    if not hidden:
        return line["verdict"] == "adequate"
    if not set(hidden) <= set(CATALOGUE):
        allowed = {"none_of_the_candidates"} | ({"adequate"} if set(hidden) <= NOISE_LIKE else set())
        return line["verdict"] in allowed
    return line["verdict"] in ("explained", "ambiguous") and set(hidden) <= named(line)


def rates(lines: list[dict[str, Any]]) -> list[list[str]]:
    """A row for each group and size: the truth reported, and nothing but the truth."""
    rows = []
    for name in GROUPS:
        chosen = [x for x in lines if group(x["hidden"], bool(x.get("removed"))) == name]
        for size in (*SIZES, "all") if name != "nothing" else ("all",):
            own = [x for x in chosen if size in ("all", x["size"])]
            if own:
                right = [x for x in own if is_right(x)]
                exactly = sum(set(x["effects"]) == set(x.get("truth", x["hidden"])) for x in right)
                errors = sum(x["verdict"] == "error" for x in own)
                rows.append([name, size, rate_text(len(right), len(own)), rate_text(exactly, len(own)), str(errors)])
                if name in ("nothing", "outside", "removed"):
                    rows[-1][3] = ""
    return rows


HEAD = ("hidden", "size", "right, 95 %", "just these effects, 95 %", "errors")


def report(lines: list[dict[str, Any]]) -> None:
    """Tables of the rates."""
    by_name: dict[str, dict[str, list[dict[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        gone = " (removed)" if line.get("removed") else ""
        by_name[(" + ".join(line["hidden"]) or "nothing") + gone][line["size"]].append(line)
    rows = []
    for name, by_size in by_name.items():
        cells = [f"{sum(map(is_right, by_size[s]))}/{len(by_size[s])}" if s in by_size else "" for s in SIZES]
        rows.append([name, *cells])
    print(aligned(("hidden", *SIZES), rows), end="\n\n")
    print(aligned(HEAD, rates(lines)), end="\n\n")
    seconds = sorted(x["seconds"] for x in lines if "seconds" in x)
    if seconds:
        print(f"seconds: median {seconds[len(seconds) // 2]:.1f}, largest {seconds[-1]:.1f}")


def draw(lines: list[dict[str, Any]], path: Path) -> None:
    """Hidden effect by what was reported first, share of the runs."""
    from matplotlib.figure import Figure

    singles = [x for x in lines if len(x["hidden"]) <= 1 and not x.get("removed")]
    rows = ["nothing", *CATALOGUE, *OUTSIDE]
    columns = [
        *CATALOGUE,
        *(slip.name for slip in (*slips.EFFECTS, *channels.EFFECTS)),
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
    """Run what is missing, or report."""
    parser = options(__doc__, workers=2)
    parser.add_argument("--bench", choices=BENCHES, action="append", help="machine; or say --kinds")
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=[])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--sizes", nargs="*", choices=SIZES, default=SIZES)
    parser.add_argument("--effects", nargs="*", default=[], help=f"names, or {', '.join(GROUPS)}; default: everything")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--picture", type=Path, help="of the confusion matrix")
    parser.add_argument("--table", type=Path, help="Markdown file of the rates")
    parser.add_argument("--wrong", action="store_true", help="list what went wrong")
    given = parser.parse_args()
    if not (given.report or given.picture or given.table or given.wrong):
        kinds = [*given.kinds, *(BENCHES[name] for name in given.bench or ())] or ["analog"]
        seeds = range(given.first_seed, given.first_seed + given.seeds)
        run_all(run, jobs(seeds, given.sizes, kinds, given.effects), given.out, given.workers)
        return
    kept = {*given.kinds, *(BENCHES[name] for name in given.bench or ())}
    lines = [x for x in read_rows(given.out) if not kept or x["kind"] in kept]
    if given.report:
        report(lines)
    if given.picture:
        draw(lines, given.picture)
    if given.table:
        given.table.write_text(markdown(HEAD, rates(lines)))
    if given.wrong:
        for x in lines:
            if not is_right(x):
                shown = (
                    "kind",
                    "hidden",
                    "removed",
                    "size",
                    "seed",
                    "verdict",
                    "effects",
                    "sets",
                    "misfits",
                    "ranking",
                )
                print(*(x.get(key, "") for key in (*shown, "error")))


if __name__ == "__main__":
    main()
