"""After an ambiguous verdict: the proposed experiment, made on the independent simulator, names the truth alone.

python tests/benchmarks/next_experiment.py 10    each case with 10 seeds: what is proposed, and what both records name
"""

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import ambid
from ambid.designs.changes import Change
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS


@dataclass(frozen=True)
class Case:
    """Physics that one record does not tell from other physics.

    Attributes
    ----------
    effect : str
    parameters : dict
        As `tests/hidden/physics.py` has them.
    amplitude : float
        Of the excitation [A].
    with_i_c : bool
        Whether the first record has i_c.
    elsewhere : bool
        Whether the cheapest experiment at another operating point is made, and not the cheapest of all.
    """

    effect: str
    parameters: dict
    amplitude: float
    with_i_c: bool = True
    elsewhere: bool = False


CASES = (
    Case("loop_delay", {"seconds": 1.5e-5}, 1.0, with_i_c=False),
    Case("loop_delay", {"seconds": 2e-5}, 0.1),
    Case("back_emf", {"coefficient": 0.3}, 0.5),
    Case("back_emf", {"coefficient": 0.3}, 0.5, elsewhere=True),
)


def first(case, seed):
    """The record that leaves the verdict ambiguous."""
    i_e = ONE_AXIS.excitation(case.amplitude)
    hidden = {case.effect: case.parameters}
    return measured(ONE_AXIS.rig, i_e, hidden, seed=2 * seed, with_i_c=case.with_i_c, **ONE_AXIS.truth)


def made(case, seed, change: Change, repeats):
    """The record of a proposed experiment: K_i follows the bias current, K_s its square."""
    rig = change.rig or ONE_AXIS.rig
    bias = rig.bearings[0].bias_current / ONE_AXIS.rig.bearings[0].bias_current
    K_i, K_s = bias * np.array(ONE_AXIS.K_i), bias**2 * np.array(ONE_AXIS.K_s)
    i_e = ONE_AXIS.excitation(change.amplitude * case.amplitude)[: ONE_AXIS.period]
    i_e = np.tile(i_e, (int(np.ceil(repeats * ONE_AXIS.periods)), 1))
    truth = {"K_i": K_i, "K_s": K_s, "tau_e": ONE_AXIS.tau_e}
    with_i_c = case.with_i_c or change.currents
    record = measured(rig, i_e, {case.effect: case.parameters}, seed=2 * seed + 1, with_i_c=with_i_c, **truth)
    return record if change.rig is None else record.at(change.rig)


def run(case, seed):
    """What was ambiguous, what is proposed, and what both records name; nothing is proposed where one was enough."""
    old = first(case, seed)
    before = ambid.diagnose(ONE_AXIS.rig, old)
    if before.verdict != "ambiguous":
        return before, None, None
    proposals = ambid.next_experiments(before)
    best = proposals.best
    if case.elsewhere:
        best = next(own for own in proposals.experiments if own.change.rig is not None)
    after = ambid.diagnose(ONE_AXIS.rig, [old, made(case, seed, best.change, best.repeats)])
    return before, best, after


def is_truth_alone(case, diagnosis):
    return diagnosis.effects == (case.effect,) and not diagnosis.ambiguous_sets


def main(seeds):
    for case in CASES:
        proposed, ends, ambiguous, alone = Counter(), Counter(), 0, 0
        for seed in range(seeds):
            before, best, after = run(case, seed)
            if best is None:
                ends[f"not ambiguous: {before.verdict} {', '.join(before.effects)}"] += 1
                continue
            ambiguous += 1
            alone += is_truth_alone(case, after)
            proposed[f"{best.change.what}, {best.seconds:.2g} s"] += 1
            if not is_truth_alone(case, after):
                ends[f"{after.verdict} {after.effects} {after.ambiguous_sets}"] += 1
        print(f"{case}\n  ambiguous {ambiguous} of {seeds}; with the proposed one the truth alone is named in {alone}")
        print("  proposed:", "; ".join(f"{what} ({count})" for what, count in proposed.most_common()))
        for end, count in ends.items():
            print(f"  otherwise: {end} ({count})", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]))
