"""A single magnet whose force law is curved: a fit of its slopes is never wrong without a word."""

import numpy as np
import pytest

from ambid import Record, diagnose, identify
from reference.levitator import Levitator, pid, pid_matrices
from tiers import first_fast

MASS, K_I, BIAS, GAP, OFF = 0.06, 1.3, 0.9, 0.01, 0.05
MACHINES = {1000.0: (0.03, (200.0, 300.0, 30.0)), 250.0: (2e-3, (250.0, 600.0, 7.0))}
"""Time constant of the coil and gains of the PID by sample rate."""


def magnet(rate: float, gap: float | None = GAP) -> Levitator:
    return Levitator(MASS, K_I, K_I * BIAS / GAP, MACHINES[rate][0], gap=gap, bias=BIAS, single=True)


def one_step(truth: Levitator, rate: float, part: float, noise: tuple[float, float], held: float = BIAS):
    """A single step by a part of the gap, about the current that holds the weight."""
    gains, samples = MACHINES[rate][1], 2000
    matrices = pid_matrices(*gains, rate)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    law = {"kind": "state_space", "implementation": "digital", "reference": True}
    rig = magnet(rate).rig(rate, law | matrices, OFF)
    r = part * GAP * (np.arange(samples) > samples // 4)
    found = truth.run(rate, pid(*gains, rate), r, np.zeros(samples), noise=noise, seed=1)
    own = {"y": found["y"], "i_c": found["i_c"] + held, "r": r[:, None]}
    return rig, Record.from_arrays(**own, sample_rate=rate, axes=rig.axes, rig=rig)


def errors(found, truth: Levitator) -> dict[str, float]:
    """How far K_i and K_s are off, in their standard errors."""
    true = {"K_i.A_zeta": truth.K_i, "K_s.A_zeta": truth.K_s}
    own = {name: found.parameters[name] for name in true}
    return {name: abs(own[name].value - value) / own[name].std_error for name, value in true.items()}


@pytest.fixture(scope="module")
def half_a_percent():
    return one_step(magnet(1000.0), 1000.0, 0.005, (1e-7, 1e-4))


def test_a_curvature_that_no_misfit_shows_is_said_and_the_intervals_hold_the_truth(half_a_percent):
    rig, record = half_a_percent
    found = identify(rig, record)
    assert found.misfit < found.misfit_bound  # 29 standard errors off, before they are widened
    assert found.inconsistency.code == "curved_force_inconsistent"
    assert found.curvature.is_seen
    assert not found.is_adequate
    assert max(errors(found, magnet(1000.0)).values()) < 2.0
    assert found.parameters["K_i.A_zeta"].std_error < 0.03 * K_I
    assert found.curvature.values["K_i.A_zeta"][1] == pytest.approx(K_I, rel=0.003)
    assert found.next_step.code == "next_fit_force_law"
    assert found.next_step.values == {"effect": "force_nonlinearity"}
    (seen,) = (own for own in found.findings if own.code == "curved_force")
    assert seen.values["travel"] == pytest.approx(0.011, abs=5e-4)
    assert seen.values["by_law"]["K_i.A_zeta"] == found.curvature.values["K_i.A_zeta"][1]


@pytest.mark.slow
def test_the_next_command_finds_the_law(half_a_percent):
    found = diagnose(*half_a_percent)
    assert found.effects == ("force_nonlinearity",)
    assert max(errors(found, magnet(1000.0)).values()) < 3.0


@pytest.mark.parametrize("part", first_fast([0.02, 0.001, 0.05]))
@pytest.mark.parametrize("rate", first_fast(MACHINES))
def test_intervals_hold_the_truth_at_any_size_of_the_step(rate, part):
    truth = magnet(rate)
    found = identify(*one_step(truth, rate, part, (1e-6, 5e-4)))
    assert max(errors(found, truth).values()) < 3.0
    assert found.is_adequate or found.next_step.code == "next_fit_force_law"


@pytest.mark.slow
def test_what_moves_no_parameter_is_not_said():
    found = identify(*one_step(magnet(250.0), 250.0, 0.001, (1e-5, 5e-3)))
    assert found.is_adequate
    assert found.curvature is None


@pytest.mark.parametrize("rate", MACHINES)
def test_a_straight_force_is_not_called_curved(rate):
    """The whole current was recorded, but the machine is a linear one: its records exclude the law."""
    truth = magnet(rate, gap=None)
    found = identify(*one_step(truth, rate, 0.02, (1e-6, 5e-4)))
    assert found.is_adequate
    assert found.curvature is None
    assert max(errors(found, truth).values()) < 3.0


@pytest.mark.slow
def test_without_a_holding_current_no_single_magnet_is_assumed():
    found = identify(*one_step(magnet(250.0), 250.0, 0.005, (1e-6, 5e-4), held=0.0))
    assert found.curvature is None
