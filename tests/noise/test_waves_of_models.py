"""A line that a model has a wave for is no noise, however far off the wave is and by whatever way it was added."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, compare, identify
from ambid.effects import find
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

RATE = ONE_AXIS.rig.sample_rate
NAMES = ("K_i.A_zeta", "K_s.A_zeta", "tau_e")
EXACT = Model(ONE_AXIS.rig).with_values(dict(zip(NAMES, (*ONE_AXIS.K_i, *ONE_AXIS.K_s, ONE_AXIS.tau_e), strict=True)))
LINE = RATE / (3 * ONE_AXIS.period)
"""From one line to the next in the three settled periods [Hz]."""
HUM = 100.4 * LINE


def hummed(amplitude=0.02, periods=4):
    """A record of few periods whose command current has a hum of this amplitude [A]."""
    i_e = ONE_AXIS.excitation(ONE_AXIS.amplitude)[: periods * ONE_AXIS.period]
    hum = amplitude * np.cos(2.0 * np.pi * HUM / RATE * np.arange(len(i_e)) + 0.7)
    made = simulate(ONE_AXIS.rig, i_e + hum[:, None], seed=1, period=ONE_AXIS.period, **ONE_AXIS.truth)
    return replace(made, i_e=i_e)


def with_wave(amplitude, frequency=HUM, model=EXACT):
    own = replace(find("periodic_disturbance"), frequency_hz=frequency, axis=0)
    return model.add(own, {"cosine": amplitude, "sine": 0.0})


@pytest.mark.parametrize("off", [0.0, 1e-4, 0.02])
@pytest.mark.parametrize("amplitude", [0.0, -0.02, 20.0])
def test_noise_is_the_same_whatever_the_wave_of_the_model(amplitude, off):
    """The wave is a thousand times too large, or against that of the record, and not quite of its frequency."""
    plain = compare(EXACT, hummed()).noise.parts[0]
    part = compare(with_wave(amplitude, HUM + off * LINE), hummed()).noise.parts[0]
    count = len(plain.window.excited)
    ratio = part.noise_power()[:count] / plain.noise_power()[:count]
    assert np.max(np.abs(np.log(ratio))) < 0.02


def test_of_two_settled_periods_too():
    """There lines are looked at where they are suspected alone: at the frequencies of effects."""
    record = hummed(periods=3)
    fit = compare(with_wave(0.2), record)
    assert [tone.frequency_hz for tone in fit.tones] == [pytest.approx(HUM)]
    assert fit.noise_ceiling_percent["average"] == pytest.approx(
        compare(EXACT, hummed(0.0, periods=3)).noise_ceiling_percent["average"], abs=0.5
    )


@pytest.mark.parametrize("amplitude", [1e-3, 1.0])
def test_a_fit_from_far_off_ends_at_the_amplitude_with_the_ceiling_above_it(amplitude):
    fit = identify(with_wave(amplitude, model=Model(ONE_AXIS.rig)), hummed())
    found = np.hypot(*(fit.parameters[f"periodic_disturbance.{part}"].value for part in ("cosine", "sine")))
    assert found == pytest.approx(0.02, rel=0.02)
    assert fit.comparison.is_adequate
    for channel, reached in fit.fit_percent.items():
        assert reached < fit.noise_ceiling_percent[channel] + 0.5


def test_a_saved_model_is_fitted_in_the_same_noise(tmp_path):
    with_wave(5.0).save(tmp_path / "model.json")
    fit = identify(tmp_path / "model.json", hummed())
    other = identify(with_wave(0.0), hummed())
    assert fit.noise_ceiling_percent == pytest.approx(other.noise_ceiling_percent, abs=0.02)
    assert fit.comparison.cost == pytest.approx(other.comparison.cost, rel=1e-3)


SPINDLE = replace(BENCHES["small"], order=7)
TURNING = SPINDLE.rig.replace(speed=2.0 * np.pi * 41.0)
ECCENTRICITY = 4e-6
"""Times mass [kg m]; without it J/dof is twelve."""


@pytest.fixture(scope="module")
def turning():
    """A record of a rotor of four axes that is out of balance."""
    i_e = SPINDLE.excitation(SPINDLE.amplitude, 1)
    hidden = {"unbalance": {"mass_eccentricity": ECCENTRICITY, "z": SPINDLE.middle, "phase": 0.7}}
    own = {**SPINDLE.truth, **SPINDLE.noise}
    return simulate(TURNING, i_e, hidden, seed=1, period=SPINDLE.period, **own)


def with_unbalance(factor):
    """As `Model.add` gives it, so many times too large."""
    of = {"in_phase": factor * ECCENTRICITY * np.cos(0.7), "ahead": factor * ECCENTRICITY * np.sin(0.7)}
    return Model(TURNING).add(replace(find("unbalance"), z=SPINDLE.middle), of)


@pytest.mark.parametrize("factor", [1e-3, 6000.0])
def test_an_unbalance_that_is_added_ends_at_its_size_with_the_ceiling_above_it(turning, factor):
    fit = identify(with_unbalance(factor), turning)
    found = np.hypot(*(fit.parameters[f"unbalance.{part}"].value for part in ("in_phase", "ahead")))
    assert found == pytest.approx(ECCENTRICITY, rel=0.02)
    assert fit.comparison.is_adequate
    for channel, reached in fit.fit_percent.items():
        assert reached < fit.noise_ceiling_percent[channel] + 0.5


def test_the_ceiling_is_the_same_whatever_unbalance_a_model_has(turning):
    ceilings = [compare(with_unbalance(factor), turning).noise_ceiling_percent for factor in (1.0, 6000.0)]
    assert ceilings[1] == pytest.approx(ceilings[0], abs=0.3)
