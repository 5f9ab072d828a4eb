"""What has a frequency of its own in records whose excitation never repeats, and the angle that it begins one at."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, compare, diagnose
from ambid.effects import find
from ambid.noise import Comparison
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from ambid.noise.tones import find_tones
from hidden.bench import simulate
from hidden.families import BENCHES, SPEED
from hidden.one_axis import ONE_AXIS
from tiers import first_fast

RATE, SAMPLES = ONE_AXIS.rig.sample_rate, 3000
NAMES = ("K_i.A_zeta", "K_s.A_zeta", "tau_e")
EXACT = Model(ONE_AXIS.rig).with_values(dict(zip(NAMES, (*ONE_AXIS.K_i, *ONE_AXIS.K_s, ONE_AXIS.tau_e), strict=True)))
WRONG = EXACT.with_values({"K_i.A_zeta": 1.3 * ONE_AXIS.K_i[0]})
TIME = np.arange(SAMPLES) / RATE


def noise(seed):
    return np.repeat(np.random.default_rng(seed).standard_normal(SAMPLES // 4), 4)


DRIVES = {
    "noise": noise,
    "steps": lambda seed: np.repeat(np.random.default_rng(seed).uniform(-1.0, 1.0, SAMPLES // 300), 300),
    "sweep": lambda seed: np.sin(2.0 * np.pi * (20.0 * TIME + 1200.0 * TIME**2) + seed),
    "sines": lambda seed: sum(np.sin(2.0 * np.pi * f * TIME + seed) for f in (23.7, 61.3, 144.9, 310.1)),
}


def made(drive, seed, *, hum=0.0, frequency=147.3, angle=0.0):
    i_e = 0.5 * DRIVES[drive](seed)
    wave = hum * np.cos(2.0 * np.pi * frequency * TIME + angle)
    record = simulate(ONE_AXIS.rig, (i_e + wave)[:, None], seed=seed, **ONE_AXIS.truth)
    return replace(record, i_e=i_e[:, None])


def tones_of(record, model):
    return find_tones(model, RecordLines(model, Measured(record)))


@pytest.mark.parametrize("model", [EXACT, WRONG], ids=["right model", "wrong model"])
@pytest.mark.parametrize("drive", first_fast(["sines", "steps", "noise", "sweep"]))
def test_what_the_excitation_brings_is_no_tone(drive, model):
    """Not even where the model misses what a sine of the excitation does."""
    found = [tone for seed in range(6) for tone in tones_of(made(drive, seed), model)]
    assert len([tone for tone in found if tone.frequency_hz not in (50.0, 60.0, 100.0, 120.0)]) == 0
    assert len(found) <= 1  # of the mains, which is suspected from the start


@pytest.mark.parametrize("drive", ["noise", "steps", "sweep"])
@pytest.mark.parametrize("frequency", [147.3, 212.9])
def test_a_hum_is_found_between_lines(drive, frequency):
    for seed in range(3):
        (tone, *more) = tones_of(made(drive, seed, hum=0.02, frequency=frequency, angle=float(seed)), EXACT)
        assert not more
        assert tone.frequency_hz == pytest.approx(frequency, abs=0.1 * RATE / SAMPLES)


@pytest.fixture(scope="module")
def hummed():
    """A diagnosis of a hum, and a record that was kept back, in which the hum has another angle."""
    train, kept_back = (made("noise", seed, hum=0.02, angle=angle) for seed, angle in ((1, 0.3), (2, 2.5)))
    return diagnose(ONE_AXIS.rig, train, validate=kept_back), kept_back


@pytest.mark.slow
def test_a_hum_is_named_whatever_its_angle_in_the_record_that_was_kept_back(hummed):
    found, _ = hummed
    assert (found.verdict, found.effects) == ("explained", ("periodic_disturbance",)), found
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.1)
    assert found.history[-1].validation_misfit == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_the_own_angle_is_where_the_misfit_is_least(hummed):
    found, kept_back = hummed
    model = found.model
    best = compare(model, kept_back)
    (part,) = best.noise.parts
    (effect,) = model.acting
    around = [part.with_angle(effect, part.angles[effect.name] + turn) for turn in np.linspace(-np.pi, np.pi, 41)]
    costs = [np.sum(own.white(own.at(model), []).residual ** 2) for own in around]
    assert int(np.argmin(costs)) == 20
    assert best.cost == pytest.approx(costs[20], rel=1e-9)
    assert best.misfit == pytest.approx(1.0, abs=0.1)
    assert Comparison(EXACT, [kept_back]).with_own_angles().cost == Comparison(EXACT, [kept_back]).cost


@pytest.mark.slow
def test_an_unbalance_is_named_where_nothing_repeats():
    bench = BENCHES["bench"]
    rig = bench.rig.replace(speed=SPEED)
    hidden = {"unbalance": {"mass_eccentricity": 2e-5, "z": bench.middle, "phase": 0.7}}
    train, kept_back = (
        simulate(rig, i_e, hidden, seed=seed, **bench.truth, **bench.noise).rows(40 * seed, 8000)
        for seed in (1, 2)
        for i_e in [0.7 * np.repeat(np.random.default_rng(seed).standard_normal((2000, 4)), 4, axis=0)]
    )
    alike = ("unbalance", "periodic_disturbance", "sensor_runout", "loop_delay")
    found = diagnose(rig, train, validate=kept_back, catalogue=[find(name) for name in alike])
    assert (found.verdict, found.effects) == ("explained", ("unbalance",)), found
    assert found.history[-1].validation_misfit == pytest.approx(1.0, abs=0.05)
