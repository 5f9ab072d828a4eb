"""Are probabilities what they say? Random machines of three populations; statements held against the truth.

    python tests/benchmarks/probabilities.py made.jsonl --machines 500
    python tests/benchmarks/probabilities.py made.jsonl --report --table probabilities.md --picture probabilities.png

Machines of each population (rotors and levitators that nobody chose, the benches), with nothing, one to three effects
of the catalogue or physics outside of it hidden, their sizes drawn between barely and clearly visible, half of the rig
files off by ordinary tolerances. That an effect of the catalogue, nothing or something else is missing is a statement
with a probability; listed are those of 1 % and more, and what is true. The log score is of all that is stated of a
machine. Calibrated is what isotonic regression of the truth on the probability leaves as it is (CORP: Dimitriadis,
Gneiting, Jordan, PNAS 118 (2021) e2016191118). It goes on where it stopped; no part of the tests.
`made/calibration.jsonl` has the machines that numbers were taken from: 8020 to 8122 by versions before, whence
`diagnosis.hypotheses.NEARNESS`, and 8176 to 8224, whence `diagnosis.probabilities.IN_PLACE` and the error of friction's
formula. That says nothing of what they are good for: `made/probabilities.jsonl` begins at machine 8225.
"""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.optimize import isotonic_regression

from ambid import Record, Rig, diagnose
from ambid.diagnosis.probabilities import PRINTED
from ambid.effects import CATALOGUE as KNOWN
from benchmarks.grid import Row, aligned, markdown, options, rate_text, read_rows, run_all
from benchmarks.levitators import sized as sized_levitator
from benchmarks.rates import NOISE_LIKE
from hidden.experiment import experiment_on
from hidden.families import BENCHES, FAMILIES, Bench
from hidden.levitators import EFFECTS, levitator
from hidden.physics import CATALOGUE, OUTSIDE
from hidden.sizes import Sized, find, score, score_beside_tolerances
from hidden.strangers import stranger
from hidden.tolerances import Machine, machine_off

POPULATIONS = ("strangers", "levitators", "benches")
HIDDEN = {"nothing": 0.2, "one": 0.3, "two": 0.25, "three": 0.1, "outside": 0.15}
"""How often so many effects, or one of no name, are hidden."""
SCORES = (200.0, 3e4)
"""Rise of J that an effect should cause, drawn evenly in its logarithm."""
SEEN = 60.0
"""Score below which an effect is invisible, where no physical size reaches what was drawn, or tolerances hide it."""
ORDER = 8
"""Of the PRBS, at the most: what an effect causes is drawn, whatever the length of the records."""
SETS = 8
"""So many of a diagnosis are kept."""
SURE, CERTAIN = 0.9, 0.98
FLOOR = 1e-4
DRAWS = 200
"""Of what would come true, were the statements calibrated."""
SMALL, NOT_SEEN = 0.03, 3e-3
"""Part of J/dof beyond 1 of which shares are told, and the least of these."""


def run(population: str, number: int) -> Row:
    """One machine and its diagnosis."""
    random = np.random.default_rng([number, POPULATIONS.index(population), 77])
    kind = str(random.choice(list(HIDDEN), p=list(HIDDEN.values())))
    line: Row = {"kind": kind}
    try:
        made = _levitator(random, kind) if population == "levitators" else _rotor(random, kind, population)
        if made is None:
            return {**line, "skipped": "no physical size is visible"}
        hidden, rig, train, validate = made
        begun = time.perf_counter()
        found = diagnose(rig, train, validate=validate)
    except Exception as error:
        return {**line, "error": f"{type(error).__name__}: {error}"}
    return {
        **line,
        "hidden": hidden,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "sets": [list(own) for own in found.ambiguous_sets],
        "misfits": [step.misfit for step in found.history],
        "failed": [test.name for test in found.adequacy.failed()],
        "probabilities": found.probabilities.as_dict(),
        "of_sets": [own.as_dict() for own in found.probabilities.sets[:SETS]],
        "seconds": time.perf_counter() - begun,
    }


Made = tuple[dict[str, float], Rig, list[Record], list[Record]]


def _drawn(random: np.random.Generator, kind: str, inside: Sequence[str], outside: Sequence[str]) -> list[str]:
    if kind == "outside":
        return [str(random.choice(outside))]
    return [str(name) for name in random.choice(inside, list(HIDDEN).index(kind), replace=False)]


def _rotor(random: np.random.Generator, kind: str, population: str) -> Made | None:
    seed = int(random.integers(1000, 100_000))
    bench = stranger(seed) if population == "strangers" else BENCHES[str(random.choice(list(BENCHES)))]
    bench = replace(bench, order=min(bench.order, ORDER))
    found = {}
    for name in _drawn(random, kind, list(CATALOGUE), list(OUTSIDE)):
        found[name] = find(name, float(np.exp(random.uniform(*np.log(SCORES)))), bench)
    amplitude = min((own.amplitude for own in found.values()), default=bench.amplitude)
    is_off = random.random() >= 0.5
    scores = {}
    for name, own in found.items():
        others = {other: each.parameters for other, each in found.items() if other != name}
        scored = score_beside_tolerances if is_off else score
        every = FAMILIES[name].on_all_lines
        scores[name] = scored(bench, {name: own.parameters}, amplitude, on_all_lines=every, beside=others)
    if any(own < SEEN for own in scores.values()):
        return None
    if not is_off:
        rig, train, validate, _ = experiment_on(bench, found, seed)
        return scores, rig, train, validate
    off = machine_off(bench.known_to(tuple(found)), seed)
    if set(off.hidden) & set(found):
        return None
    records = [_off_record(off, bench, found, amplitude, seed, k) for k in range(2)]
    return scores, off.known, records[:1], records[1:]


def _off_record(off: Machine, bench: Bench, found: dict[str, Sized], amplitude: float, seed: int, k: int) -> Record:
    return off.record(
        bench.excitation(amplitude, seed + k),
        2 * seed + k,
        {name: dict(own.parameters) for name, own in found.items()},
        period=bench.period,
        flexible_modes=None if "rotor_bending_mode" in found else bench.rig.rotor.flexible_modes,
        **bench.truth,
        **bench.noise,
    )


def _levitator(random: np.random.Generator, kind: str) -> Made | None:
    machine = levitator(int(random.integers(1000, 100_000)))
    inside = [name for name in EFFECTS if name in CATALOGUE]
    hidden = {}
    for name in _drawn(random, kind, inside, [name for name in EFFECTS if name not in inside]):
        hidden[name] = sized_levitator(machine, name)
    if any(own is None for own in hidden.values()):
        return None
    train, validate = ([machine.record(hidden, seed)] for seed in (1, 2))
    return dict.fromkeys(hidden, np.nan), machine.rig, train, validate


class Statement(NamedTuple):
    """That an effect, nothing or something else is missing."""

    population: str
    hidden: int
    name: str
    p: float
    is_true: bool

    @property
    def is_listed(self) -> bool:
        """Whether a person reads of it, or should."""
        return self.p >= PRINTED or self.is_true


def statements(row: Row) -> Iterator[Statement]:
    """All that a diagnosis states, of effects that it does not list too."""
    stated = row["probabilities"]
    is_outside = row["kind"] == "outside"
    truth = {"something_else"} if is_outside else set(row["hidden"]) or {"nothing"}
    for name in sorted({effect.name for effect in KNOWN} | {"nothing", "something_else"}):
        yield Statement(row["key"][0], len(row["hidden"]), name, stated.get(name, 0.0), name in truth)


def as_verdict(row: Row) -> dict[str, float]:
    """The same statements by the verdict alone: 0.9 of what it names, 0.1 of all else."""
    named = {*row["effects"], *(name for own in row["sets"] for name in own)}
    named |= {"adequate": {"nothing"}, "none_of_the_candidates": {"something_else"}}.get(row["verdict"], set())
    return {own.name: 0.9 if own.name in named else 0.1 for own in statements(row)}


def log_score(p: Sequence[float], truth: Sequence[bool], machines: int) -> float:
    """Minus the log of what was given to what came, the mean of machines."""
    p = np.clip(np.array(p), FLOOR, 1.0 - FLOOR)
    return float(-np.sum(np.log(np.where(truth, p, 1.0 - p))) / machines)


def share_left(row: Row) -> float:
    """Of what the base model leaves, that which a set leaves."""
    first, *_ = beyond = [misfit - 1.0 for misfit in row["misfits"]]
    return float(np.clip(min(beyond) / first, NOT_SEEN, 1.0))


def report(rows: list[Row], table: Path | None, picture: Path | None) -> None:
    """By population and number of effects; the reliability diagram."""
    drawn = [row for row in rows if "verdict" in row]
    kept = [row for row in drawn if not set(row["hidden"]) & NOISE_LIKE]
    head = ("population", "hidden", "machines", "90 % and more: true", "log score", "by verdict")
    lines = []
    for population in (*POPULATIONS, "all"):
        for hidden in ("nothing", "one", "two", "three", "outside", "all"):
            own = [r for r in kept if population in ("all", r["key"][0]) and hidden in ("all", r["kind"])]
            said = [s for r in own for s in statements(r)]
            if not own:
                continue
            sure = [s.is_true for s in said if s.p >= SURE]
            plain = [as_verdict(r)[s.name] for r in own for s in statements(r)]
            truth = [s.is_true for s in said]
            scores = (log_score(p, truth, len(own)) for p in ([s.p for s in said], plain))
            lines.append((population, hidden, len(own), rate_text(sum(sure), len(sure)), *(f"{x:.3f}" for x in scores)))
    said = sorted((s for r in kept for s in statements(r) if s.is_listed), key=lambda s: s.p)
    p, truth = np.array([s.p for s in said]), np.array([s.is_true for s in said], dtype=float)
    calibrated = isotonic_regression(truth).x
    print(aligned(head, lines))
    print(f"{len(rows)} machines, {len(rows) - len(drawn)} skipped or failed, {len(said)} listed statements")
    print(f"{len(drawn) - len(kept)} apart whose hidden effect is louder noise, to any diagnosis")
    drawn_again = np.random.default_rng(0).random((DRAWS, len(p))) < p
    by_chance = np.mean([np.abs(p - isotonic_regression(own.astype(float)).x).mean() for own in drawn_again])
    print(
        f"expected calibration error {np.mean(np.abs(p - calibrated)):.4f}; {by_chance:.4f} were all of them calibrated"
    )
    certain = [s for s in said if s.p >= CERTAIN and s.name not in ("nothing", "something_else")]
    print(f"{len(certain)} effects of {CERTAIN:.0%} and more, {sum(not s.is_true for s in certain)} not there")
    shares = [share_left(row) for row in kept if row["kind"] == "outside" and row["misfits"][0] > 1.0 + SMALL]
    if shares:
        power = -1.0 / np.mean(np.log(shares))
        error = power / np.sqrt(len(shares))
        print(f"outside: no larger share x is left than in x^{power:.2f} +- {error:.2f} of {len(shares)} machines")
    for kind in ("nothing", "outside"):
        own = [row for row in kept if row["kind"] == kind and not row["effects"]]
        seen = ", ".join(f"{name} {sum(name in row['failed'] for row in own)}" for name in ("misfit", "ways"))
        print(f"{kind} hidden and no effect named: {len(own)} machines; tests that the base model fails: {seen}")
    if table is not None:
        table.write_text(markdown(head, lines))
    if picture is not None:
        _draw(p, calibrated, picture)


def _draw(p: np.ndarray, calibrated: np.ndarray, picture: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 5.5), layout="constrained")
    curve, counts = figure.subplots(2, 1, height_ratios=(4, 1), sharex=True)
    curve.plot([0, 1], [0, 1], color="0.7", lw=1.0)
    curve.step(p, calibrated, where="mid", color="C0")
    curve.set(ylabel="share that is true", xlim=(0, 1), ylim=(0, 1))
    counts.hist(p, bins=20, range=(0, 1), color="C0", log=True)
    counts.set(xlabel="probability", ylabel="statements")
    figure.savefig(picture, dpi=150)


def main() -> None:
    """Run what is missing, or report."""
    parser = options(__doc__, workers=1)
    parser.add_argument("out", type=Path)
    parser.add_argument("--machines", type=int, default=500, help="of each population")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--table", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    if given.report:
        report(read_rows(given.out), given.table, given.picture)
        return
    numbers = range(given.first, given.first + given.machines)
    run_all(run, [(population, k) for k in numbers for population in POPULATIONS], given.out, given.workers)


if __name__ == "__main__":
    main()
