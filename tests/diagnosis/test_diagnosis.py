"""The diagnosis of four axes: nothing and two effects hidden; an effect of one's own. Each one is in test_rates."""

import numpy as np
import pytest

import ambid
from ambid.diagnosis import diagnose, rank
from ambid.effects import CATALOGUE, Effect, EffectParameter
from hidden.bench import measured
from hidden.families import BENCHES
from tiers import first_fast

TRUTH = BENCHES["bench"].truth
SEAL = {"z": 0.43, "direct": 8e5, "cross": 6e5, "damping": 300.0}


@pytest.fixture(scope="module")
def i_e():
    return ambid.prbs(7, amplitude=1.0, hold=4, axes=4, periods=4)


def record(rig, i_e, hidden, seed):
    return measured(rig, i_e, hidden, seed=seed, **TRUTH)


@pytest.mark.parametrize("seed", first_fast(range(2), 0))
def test_nothing_hidden_is_adequate(rig, i_e, seed):
    found = diagnose(rig, record(rig, i_e, {}, seed))
    assert found.verdict == "adequate"
    assert found.effects == ()
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.06)


@pytest.mark.slow
def test_two_effects_at_once(rig, i_e):
    hidden = {"loop_delay": {"seconds": 5e-5}, "seal_forces": SEAL}
    found = diagnose(rig, record(rig, i_e, hidden, 3))
    assert set(found.effects) == set(hidden)
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.06)


class DriveEndDamper(Effect):
    """A damper to ground at z = 0: a user's own effect, in a few lines."""

    name = "drive_end_damper"
    physics = "a squeeze-film damper at the free end of the shaft"
    signature = "rigid-body band, both planes alike"
    source = "the user's own drawing"

    def parameters(self, rig):
        return [EffectParameter("damping", "N s/m", 50.0)]

    def positions(self, rig):
        return [0.0]

    def attach(self, plant):
        for plane in np.eye(plant.rotor.planes):
            force = plant.port(self.slot("damping"), plant.at(0.0, plane, "eta_rate"))
            plant.push(0.0, plane, -force)


@pytest.mark.slow
def test_an_effect_of_ones_own_is_ranked_first_and_takes_the_error_to_the_ceiling(rig, i_e):
    data = record(rig, i_e, {"coupling_stiffness": {"stiffness": 0.0, "damping": 80.0, "z": 0.0}}, 5)
    estimate = ambid.identify(rig, data)
    comparison = ambid.compare(estimate.model, data)
    assert comparison.records[0].misfit > 1.1
    catalogue = [effect for effect in CATALOGUE if effect.name != "coupling_stiffness"]
    ranking = rank(comparison, [*catalogue, DriveEndDamper()])
    assert ranking.candidates[0].effect.name == "drive_end_damper"
    assert ranking.candidates[0].start["damping"] == pytest.approx(80.0, rel=0.2)
    better = ambid.identify(estimate.model.add(DriveEndDamper(), ranking.candidates[0].start), data)
    assert better.parameters["drive_end_damper.damping"].value == pytest.approx(80.0, rel=0.05)
    assert ambid.compare(better.model, data).records[0].misfit == pytest.approx(1.0, abs=0.05)
    assert better.fit_percent["average"] == pytest.approx(better.noise_ceiling_percent["average"], abs=0.1)
