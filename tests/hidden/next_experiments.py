"""Ambiguous verdicts of the independent simulator, and the experiment that is proposed after them, made there."""

from dataclasses import dataclass

import numpy as np

import ambid
from ambid.designs.separation import Change
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS


@dataclass(frozen=True)
class Case:
    """Physics that one record does not distinguish from other physics.

    Attributes
    ----------
    effect : str
    parameters : dict
        As `tests/hidden/physics.py` has them.
    amplitude : float
        Of the excitation [A].
    with_i_c : bool
        Whether the first record has i_c.
    """

    effect: str
    parameters: dict
    amplitude: float
    with_i_c: bool = True


CASES = (
    Case("loop_delay", {"seconds": 1.5e-5}, 1.0, with_i_c=False),
    Case("loop_delay", {"seconds": 2e-5}, 0.1),
    Case("back_emf", {"coefficient": 0.3}, 0.5),
)


def first(case, seed, bench=ONE_AXIS):
    """The record that leaves the verdict ambiguous."""
    i_e = bench.excitation(case.amplitude)
    hidden = {case.effect: case.parameters}
    return measured(bench.rig, i_e, hidden, seed=2 * seed, with_i_c=case.with_i_c, **bench.truth)


def made(case, seed, change: Change, repeats, bench=ONE_AXIS):
    """The record of a proposed experiment: K_i follows the bias current, K_s its square."""
    rig = change.rig or bench.rig
    bias = rig.bearings[0].bias_current / bench.rig.bearings[0].bias_current
    K_i, K_s = bias * np.array(bench.K_i), bias**2 * np.array(bench.K_s)
    i_e = bench.excitation(change.amplitude * case.amplitude)[: bench.period]
    i_e = np.tile(i_e, (int(np.ceil(repeats * bench.periods)), 1))
    truth = {"K_i": K_i, "K_s": K_s, "tau_e": bench.tau_e}
    with_i_c = case.with_i_c or "i_c" in change.record
    record = measured(rig, i_e, {case.effect: case.parameters}, seed=2 * seed + 1, with_i_c=with_i_c, **truth)
    return record if change.rig is None else record.at(change.rig)


def run(case, seed, bench=ONE_AXIS):
    """What was ambiguous, what is proposed, and what both records name; nothing is proposed where one was enough."""
    old = first(case, seed, bench)
    before = ambid.diagnose(bench.rig, old)
    if before.verdict != "ambiguous":
        return before, None, None
    proposals = ambid.next_experiments(before)
    best = proposals.best
    after = ambid.diagnose(bench.rig, [old, made(case, seed, best.change, best.repeats, bench)])
    return before, best, after


def is_truth_alone(case, diagnosis):
    return diagnosis.effects == (case.effect,) and not diagnosis.ambiguous_sets
