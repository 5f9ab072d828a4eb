"""The whole story on data that come with the package."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ambid.campaigns.result import interval_text
from ambid.diagnosis import Diagnosis, compare, diagnose
from ambid.identification import Estimate, StaticEstimate, identify, static_load
from ambid.identification.tolerances import share_text
from ambid.plot import plot_misfit_map, plot_ranking, plot_staircase, save_comparison, save_figure
from ambid.record import Record, StaticLoading
from ambid.report import write_report
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread
from ambid.writing import make_folder

DATA = Path(__file__).parent / "data"
"""A two-bearing test bench at 6 A bias.

The rig file, a pseudo-random record and five static loadings; then two records of the bench with something in it that
the rig file does not state (`hidden_train.mat`; `hidden_validate.mat` at half the amplitude), and `hidden_truth.json`.
"""

FILES = ("report.html", "measured_and_simulated.png", "misfit_map.png", "ranking.png", "misfit_falls.png", "model.json")
"""What the story leaves in its folder, in the order of reading."""


@with_one_blas_thread
def run(out: Path, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Identify a bench whose physics is not all in its rig file, find what is missing, and check K_i another way.

    Parameters
    ----------
    out : Path
        Folder for the report, the pictures and the model; made if needed.
    say : callable
        Takes each piece of the story.

    Returns
    -------
    dict
        Plain data of all results, and the files written.
    """
    begun = time.perf_counter()
    make_folder(out)
    rig = Rig.load(DATA / "rig.toml")
    train, validate = (Record.load(DATA / f"hidden_{name}.mat", rig) for name in ("train", "validate"))
    say(
        f"1. Closed-loop identification\nA rig file, and a record of the levitated rotor:\n{train}\n"
        "From the rig's nominal values, K_i, K_s and tau_e are fitted to it:\n"
    )
    estimate = identify(rig, train)
    say(
        f"{estimate}\n\nIt looks well: narrow intervals, and a fit of {estimate.fit_percent['average']:.1f} %. "
        "But is it right?\n"
    )
    comparison = compare(estimate.model, train)
    misfit = comparison.records[0].misfit
    say(
        f"2. What the model misses\n{comparison}\n\nOn the excited lines the residual has {misfit:.0f} times the "
        "power of the noise, and it repeats: physics is missing.\n"
    )
    say("3. Which physics is it? Every effect of the catalogue is scored, the best are refitted, one is added:")
    found = diagnose(rig, train, validate=[validate], say=lambda line: say(f"   {line}"))
    say(f"\nThe ranking before anything was added, best first:\n{_head(found)}\n\n{found}\n")
    say(f"What adding it did to the parameters:\n{_came_right(estimate, found)}\n")
    say(f"4. Validation\n{_validated(found)}\n")
    healthy = identify(rig, Record.load(DATA / "prbs.mat", rig))
    loading = static_load(rig, [StaticLoading.load(path, rig) for path in sorted(DATA.glob("static_*.csv"))])
    say(f"5. K_i another way [N/A]: static loading of the bench as its rig file states it\n{_both(healthy, loading)}\n")
    uncertain = identify(rig.replace(tolerance={}), healthy.records)
    say(f"6. How well is the rig file known?\n{_of_tolerances(healthy, uncertain)}\n")
    files = _write(found, out)
    seconds = time.perf_counter() - begun
    say(f"In {seconds:.0f} s. Everything is in the folder {out}; begin with {files[0]}:")
    for file in files:
        say(f"   {file}")
    return {
        "identify": estimate.to_json(),
        "compare": comparison.to_json(),
        "diagnose": found.to_json(),
        "closed_loop": healthy.to_json(),
        "with_tolerances": uncertain.to_json(),
        "static_load": loading.to_json(),
        "files": [str(file) for file in files],
        "seconds": seconds,
    }


def _head(found: Diagnosis, rows: int = 5) -> str:
    lines = [f"{'effect':24s} {'misfit would be':>15s}"]
    lines += [f"{c.effect.name:24s} {c.predicted_misfit:15.2f}" for c in found.history[0].ranking.candidates[:rows]]
    return "\n".join(lines)


def _came_right(estimate: Estimate, found: Diagnosis) -> str:
    """Parameters before and after, beside the truth, which is known of a demonstration."""
    truth = json.loads((DATA / "hidden_truth.json").read_text(encoding="utf-8"))
    lines = [f"{'parameter':16s} {'true':>11s} {'at first':>11s} {'error %':>8s} {'in the end':>11s} {'error %':>8s}"]
    for p in (own for own in found.model.parameters if own.prior is None):
        true, guess = truth[p.name], estimate.parameters.get(p.name)
        before = f"{'':20s}" if guess is None else _against(guess.value, true)
        lines.append(f"{p.name:16s} {true:11.5g} {before} {_against(p.value, true)}")
    first = [(p.ci95, truth[name]) for name, p in estimate.parameters.items() if p.ci95 is not None]
    held = sum(low <= true <= high for (low, high), true in first)
    lines.append(
        f"Of the narrow intervals at first, {held} of {len(first)} held the truth: the fit had bent the parameters "
        "to make up for what was missing."
    )
    return "\n".join(lines)


def _against(value: float | None, true: float) -> str:
    return f"{'unknown':>20s}" if value is None else f"{value:11.5g} {100.0 * (value / true - 1.0):8.2f}"


def _validated(found: Diagnosis) -> str:
    first, last = found.history[0], found.history[-1]
    return (
        f"On the record at half the amplitude, which no fit has seen, the misfit falls from "
        f"{first.validation_misfit:.1f} to {last.validation_misfit:.2f} (1 is noise alone)."
    )


def _both(estimate: Estimate, loading: StaticEstimate) -> str:
    lines = [f"{'':12s} {'closed-loop identification':>32s} {'static loading':>32s}"]
    for name, static in loading.parameters.items():
        lines.append(f"{name:12s} {interval_text(estimate.parameters[name]):>32s} {interval_text(static):>32s}")
    return "\n".join(lines)


def _of_tolerances(exact: Estimate, uncertain: Estimate) -> str:
    """What typical tolerances of the rig file make of the first interval."""
    name = next(iter(uncertain.parameters))
    verse = [
        "This bench is simulated, and its rig file says that every value is exact. Of a machine none is: with typical",
        f"tolerances the same record gives {name} as {interval_text(uncertain.parameters[name])} in place of",
        f"{interval_text(exact.parameters[name])}. What makes that variance:",
        f"   {share_text(uncertain.budget()[name])}",
        "A longer record makes noise less; for the rest, calibrate, weigh or measure what stands first.",
    ]
    return "\n".join(verse)


def _write(found: Diagnosis, out: Path) -> list[Path]:
    """Report, pictures and model, in the order of reading."""
    report, drawn, where, ranking, falls, model = (out / name for name in FILES)
    write_report(found, report)
    save_comparison(compare(found.model, found.records), drawn)
    pictures = {ranking: plot_ranking(found.history[0].ranking), falls: plot_staircase(found)[0]}
    if found.localisation is not None:
        pictures = {where: plot_misfit_map(found.localisation)} | pictures
    for path, axes in pictures.items():
        save_figure(axes.figure, path, dpi=150)
    found.save(model)
    return [report, drawn, *pictures, model]
