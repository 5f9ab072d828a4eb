"""Effects of a user's own, in a few lines of Python: a function, a linear system, a disturbance."""

import numpy as np
import pytest

import ambid
from ambid.diagnosis import diagnose, rank
from ambid.effects import CATALOGUE, Effect, EffectParameter
from hidden.experiment import experiment
from hidden.one_axis import NAMED, NAMELESS, ONE_AXIS, record
from tiers import first_fast


class Hardening(Effect):
    """A function of a signal: a centring force that grows with the cube of the displacement."""

    name = "hardening"
    physics = "touch-down bearings that centre the rotor with a cubic force"
    signature = "odd, grows with the cube of the displacement"
    source = "the user's own idea"

    def parameters(self, rig):
        return [EffectParameter("cubic", "N/m^3", 1e12)]

    def attach(self, plant):
        for axis in plant.axes:
            push = plant.table(lambda s: -(s**3), [plant[f"s.{axis}"]], reach=[5e-5], slot=self.slot("cubic"))
            plant.inject(f"f.{axis}", push)


class AntiAliasing(Effect):
    """A linear system as matrices: a second-order filter of the sensor, blended in."""

    name = "anti_aliasing"
    physics = "the sensor's anti-aliasing filter, 10 kHz Bessel"
    signature = "y late at high frequency"
    source = "data sheet"

    def parameters(self, rig):
        return [EffectParameter("share", "1", 0.1, upper=2.0)]

    def attach(self, plant):
        w = 2.0 * np.pi * 1e4
        matrices = ([[-w]], [[w]], [[1.0]], [[0.0]])
        for axis in plant.axes:
            (filtered,) = plant.system(f"filter.{axis}", matrices, [plant.raw(f"y.{axis}")])
            late = plant.port(self.slot("share"), filtered - plant.raw(f"y.{axis}"))
            plant.inject(f"y.{axis}", late)


class Pump(Effect):
    """A disturbance of known shape: a pump that shakes the current of the first axis at 50 Hz."""

    name = "pump"
    physics = "the cooling pump next to the bench"
    signature = "50 Hz in the first axis"
    source = "the user's own ears"

    def parameters(self, rig):
        return [EffectParameter(name, "A", 1e-4, lower=-1.0, upper=1.0) for name in ("cosine", "sine")]

    def waveform(self, rig, samples, record):
        angle = 2.0 * np.pi * 50.0 / rig.sample_rate * np.arange(samples)
        return np.column_stack([np.cos(angle), np.sin(angle)])

    def attach(self, plant):
        for name in ("cosine", "sine"):
            wave = plant.port(self.slot(name), plant.input(f"pump.{name}"))
            plant.inject(f"i_ref.{plant.axes[0]}", wave)


OWN = {
    "sensor_lag": (AntiAliasing(), ("sensor_lag",)),
    "cubic_bearing_force": (Hardening(), ()),
    "periodic_disturbance": (Pump(), ("periodic_disturbance",)),
}


@pytest.mark.parametrize("hidden", first_fast(OWN))
def test_it_is_ranked_first_and_takes_the_error_to_the_ceiling(hidden):
    own, rivals = OWN[hidden]
    rig, (train, validate) = ONE_AXIS.rig, (record({hidden: (NAMED | NAMELESS)[hidden]}, seed) for seed in (5, 6))
    catalogue = [effect for effect in CATALOGUE if effect.name not in rivals]
    comparison = ambid.compare(ambid.identify(rig, train).model, train)
    assert rank(comparison, [*catalogue, own]).candidates[0].effect.name == own.name
    found = diagnose(rig, train, validate=[validate], catalogue=[*catalogue, own])
    assert found.verdict == "explained"
    assert found.effects == (own.name,)
    first, last = found.history[0], found.history[-1]
    assert first.misfit > 1.1
    assert last.misfit == pytest.approx(1.0, abs=0.08)  # three standard deviations
    assert last.validation_misfit == pytest.approx(1.0, abs=0.1)
    ceiling = ambid.compare(found.model, train).records[0].channels
    assert all(c.fit_percent > c.noise_ceiling_percent - 0.1 for c in ceiling)


def test_a_function_runs_at_the_speed_of_the_core():
    """The table stands for the function: the same response as the polynomial that it samples."""
    rig, (train,), _, _ = experiment("cubic_bearing_force", "clear", 5)
    model = ambid.Model(rig).add(Hardening(), {"cubic": 1e14})
    size = np.abs(model.simulate(train.i_e).y).max()
    plain = ambid.Model(rig).simulate(train.i_e).y

    class Exact(Hardening):
        def attach(self, plant):
            for axis in plant.axes:
                force = plant.block("polynomial", [plant[f"s.{axis}"]], {"c0": self.slot("cubic")}, exponents=[[3]])
                plant.inject(f"f.{axis}", -force)

    exact = ambid.Model(rig).add(Exact(), {"cubic": 1e14}).simulate(train.i_e).y
    assert np.abs(plain - exact).max() > 1e-3 * size
    np.testing.assert_allclose(model.simulate(train.i_e).y, exact, atol=1e-5 * size)
