"""Without periods, what is not linear is taken for noise: it shows in the whole of what is left, and in its shape."""

import numpy as np
import pytest

from ambid import Model, Record, compare, identify
from ambid.noise import unseen
from ambid.noise.shapes import Shapes
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS
from tiers import first_fast

TRUE = {"K_i.A_zeta": ONE_AXIS.K_i[0], "K_s.A_zeta": ONE_AXIS.K_s[0], "tau_e": ONE_AXIS.tau_e}
FRICTION = {"coulomb_friction": {"force": 3.0, "z": ONE_AXIS.middle}}


def record(seed: int, hidden: dict, chips: int = 1000) -> Record:
    """A random excitation that never repeats."""
    i_e = np.repeat(ONE_AXIS.amplitude * np.random.default_rng([seed, 3]).choice([-1.0, 1.0], (chips, 1)), 4, axis=0)
    return measured(ONE_AXIS.rig, i_e, hidden, seed=seed, **ONE_AXIS.truth)


@pytest.mark.parametrize("seeds", [5, pytest.param(15, marks=pytest.mark.slow)])
def test_a_right_model_leaves_no_more_than_noise_and_no_shape(seeds):
    model = Model(ONE_AXIS.rig).with_values(TRUE)
    found = [compare(model, record(seed, {})) for seed in range(seeds)]
    assert [own.inconsistency for own in found] == [None] * seeds


@pytest.mark.parametrize("seed", first_fast(range(4)))
def test_friction_is_seen_where_the_misfit_takes_it_for_noise(seed):
    found = identify(ONE_AXIS.rig, record(seed, FRICTION))
    assert found.misfit < found.misfit_bound
    assert not found.is_adequate
    assert found.inconsistency.code == "residual_inconsistent"
    assert found.inconsistency.values["when"] == "in all"
    assert {"residual_above_noise", "intervals_widened"} <= {own.code for own in found.findings}


@pytest.mark.parametrize("seed", first_fast(range(4)))
def test_a_small_dead_band_is_seen_by_its_shape_alone(seed):
    found = identify(ONE_AXIS.rig, record(seed, {"amplifier_dead_band": {"current": 0.002}}))
    assert found.misfit < found.misfit_bound
    (shape,) = found.comparison.adequacy.failed()
    assert found.inconsistency.code == "nonlinear_residual"
    assert found.inconsistency.values["kind"] == shape.values["kind"] == "odd"


def test_the_shape_is_looked_for_in_the_beginning_of_a_long_record(monkeypatch):
    monkeypatch.setattr(unseen, "LONGEST", 4000)
    searched = []

    class Watched(Shapes):
        @classmethod
        def of(cls, sight, part):
            searched.append(part)
            return super().of(sight, part)

    monkeypatch.setattr(unseen, "Shapes", Watched)
    found = identify(ONE_AXIS.rig, record(5, {"amplifier_dead_band": {"current": 0.002}}, chips=2500))
    assert [own.values["kind"] for own in found.comparison.adequacy.failed("shape")] == ["odd"]
    assert [part.record.samples for part in searched] == [4000]
    model = Model(ONE_AXIS.rig).with_values(TRUE)
    assert [compare(model, record(seed, {}, chips=2500)).is_adequate for seed in range(2)] == [True] * 2
    assert {part.record.samples for part in searched} == {4000}
