"""One force law through the slopes of several gaps, identified from records of an independent simulator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import combine_pvalues

from ambid import ForceLaw, StaticForce, fit_force_law, identify
from ambid.errors import ModelError
from ambid.excitation import prbs
from ambid.identification import DIPOLES, SQUARE
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS

BIAS = 4.0
GAPS = (6e-4, 5e-4, 7.5e-4)
IRON, STRENGTH = 3e-5, 6e-6
RARE = 1e-3
"""Chance of records on which what is right fails here."""


def slopes(gap):
    """By hand: K_i and K_s of ``k (i/(g + a))^2``."""
    k_i = 2.0 * STRENGTH * BIAS / (gap + IRON) ** 2
    return k_i, k_i * BIAS / (gap + IRON)


def at_gap(gap, seed, factor=1.0):
    k_i, k_s = slopes(gap)
    bearing = ONE_AXIS.rig.bearings[0].model_copy(
        update={"air_gap": gap, "force_current": (1.05 * k_i,), "force_displacement": (0.95 * k_s,)}
    )
    gains = {"proportional": 1.3 * k_s / k_i, "derivative": 45.0 * slopes(GAPS[0])[0] / k_i}
    controller = ONE_AXIS.rig.controller.model_copy(update=gains)
    rig = ONE_AXIS.rig.replace(name=f"{1e3 * gap:g} mm", bearings=(bearing,), controller=controller)
    i_e = prbs(8, amplitude=0.5, hold=4, periods=5)
    record = measured(rig, i_e, {}, seed=seed, K_i=(factor * k_i,), K_s=(k_s,), tau_e=ONE_AXIS.tau_e)
    return record.at(rig)


def identified(first_seed):
    records = [at_gap(gap, seed) for seed, gap in enumerate(GAPS, first_seed)]
    return identify(records[0].point, records)


@pytest.fixture(scope="module")
def estimate():
    return identified(0)


SIMPLE = ForceLaw("simple", "k (i/(g + a))^2", {"k": 1e-5, "a": 1e-5}, lambda i, g, k, a: k * (i / (g + a)) ** 2)


@pytest.mark.parametrize("campaigns", [4, pytest.param(12, marks=pytest.mark.slow)])
def test_the_right_law_is_as_likely_as_its_p_value(estimate, campaigns):
    others = (identified(10 * k) for k in range(1, campaigns))
    values = [fit_force_law(own, SIMPLE).p_value for own in (estimate, *others)]
    assert combine_pvalues(values).pvalue > RARE


def test_every_gap_has_its_own_slopes(estimate, validated):
    names = [f"{kind}.A_zeta{end}" for kind in ("K_i", "K_s") for end in ("", "@0.5mm", "@0.75mm")]
    assert set(estimate.parameters) == {*names, "tau_e"}
    for gap, end in zip(GAPS, ("", "@0.5mm", "@0.75mm"), strict=True):
        for kind, truth in zip(("K_i", "K_s"), slopes(gap), strict=True):
            found = estimate.parameters[f"{kind}.A_zeta{end}"]
            validated(
                "K_i and K_s at three gaps together: error in standard errors",
                "slopes of k (i/(g + a))^2 by hand, records of the independent simulator in C",
                (found.value - truth) / found.std_error,
                4.0,
            )


def test_the_law_comes_out_and_holds_where_nothing_was_recorded(estimate):
    found = fit_force_law(estimate, SIMPLE)
    for name, truth in (("k", STRENGTH), ("a", IRON)):
        assert abs(found.parameters[name].value - truth) < 4.0 * found.parameters[name].std_error
    assert found.slopes(BIAS, 5.5e-4) == pytest.approx(slopes(5.5e-4), rel=2e-3)
    assert found.force(2.0, 6e-4) == pytest.approx(STRENGTH * (2.0 / 6.3e-4) ** 2, rel=2e-3)
    values = {p.name: p.value for p in found.model.parameters}
    np.testing.assert_allclose([values["K_i.A_zeta@0.5mm"], values["K_s.A_zeta@0.5mm"]], found.by_law[0], rtol=1e-12)
    assert "misfit" in str(found)


def test_a_gap_that_breaks_the_law_is_told():
    records = [at_gap(gap, seed, 1.0 if seed else 1.1) for seed, gap in enumerate(GAPS)]
    assert fit_force_law(identify(records[0].point, records), SIMPLE).p_value < 1e-6


def test_static_forces_test_the_value_of_the_law(estimate):
    gaps = (5e-4, 7e-4)
    truth = [StaticForce(3.0, gap, STRENGTH * (3.0 / (gap + IRON)) ** 2, 1.0) for gap in gaps]
    assert fit_force_law(estimate, SIMPLE, truth).p_value > RARE
    wrong = [one._replace(force=1.1 * one.force) for one in truth]
    found = fit_force_law(estimate, SIMPLE, wrong)
    assert found.p_value < 1e-6
    assert len(found.summary()) == 2 + len(wrong)  # the law, how it holds, and a line for each static force
    assert fit_force_law(estimate, SQUARE, truth).p_value > RARE


def test_what_does_not_test_a_law_is_refused(estimate, golden):
    with golden.raises(ModelError):
        fit_force_law(estimate, SIMPLE, axis="B_eta")
    fixed = identify(estimate.model, estimate.records, fixed=["K_s.A_zeta@0.5mm"])
    with golden.raises(ModelError):
        fit_force_law(fixed, SIMPLE)
    alone = identify(estimate.model.rig, replace(estimate.records[0], point=None))
    with golden.raises(ModelError):
        fit_force_law(alone, DIPOLES)
