"""Records without periods: the misfit of noise is one, what is hidden is named; and voltage-driven coils."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ambid
from ambid import Model, Record, Rig
from ambid.demo import DATA
from ambid.diagnosis import diagnose
from ambid.effects.sensor import SamplingSkew
from ambid.loop.loop import open_plant
from ambid.loop.response import frequency_response
from ambid.noise.window import Window, findings_of, thinned
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from reference.whitening import Whitening

LEVITATOR = """
name = "levitator"
sample_rate = 300.0
[rotor]
kind = "mass"
mass = 1e-3
[[bearing]]
name = "A"
axes = ["zeta"]
position = 0.0
sensor_position = 0.0
bias_current = 0.02
air_gap = 0.014
force_current = 0.25
force_displacement = 2.5
[tolerance]
exact = true

[amplifier]
time_constant = 1e-5
resistance = 200.0
[actuator]
has_lag = false
[controller]
kind = "pid"
implementation = "digital"
proportional = 3000.0
integral = 10000.0
derivative = 60.0
derivative_time_constant = 1e-3
"""


def test_noise_beside_an_excitation_has_a_misfit_of_one():
    window, random = Window(4000, 1, 500), np.random.default_rng(0)
    misfits = []
    for _ in range(20):
        inputs = random.choice([-1.0, 1.0], (4500, 2))
        white = random.standard_normal((4501, 3)) @ random.standard_normal((3, 3))
        noise = white[1:] + 0.5 * white[:-1]
        spread = Whitening.beside(noise, inputs, window).white(noise)
        misfits.append(np.mean(spread**2))
    assert abs(np.mean(misfits) - 1.0) < 0.01


def test_what_follows_the_excitation_is_no_noise():
    """A residual of a tenth of the noise that follows the input raises J by its own power, not the noise by it."""
    window, random = Window(8000, 1, 500), np.random.default_rng(1)
    inputs, noise = random.choice([-1.0, 1.0], (8500, 1)), random.standard_normal((8500, 1))
    follows = np.vstack([np.zeros((3, 1)), 3.0 * inputs[:-3]])
    spread = Whitening.beside(noise + follows, inputs, window).white(noise + follows)
    assert np.mean(spread**2) == pytest.approx(1.0 + 3.0**2, rel=0.05)


def test_too_short_a_record_is_refused(golden):
    window = Window(30, 1, 4)
    with golden.raises(ambid.RecordError):
        Whitening.beside(np.random.default_rng(2).standard_normal((34, 8)), np.ones((34, 4)), window)


DELAY = {"loop_delay": {"seconds": 5e-5}}


@pytest.mark.parametrize(
    ("machine", "hidden"),
    [
        pytest.param(ONE_AXIS, {}, id="one axis-nothing"),
        pytest.param(ONE_AXIS, DELAY, id="one axis-loop_delay", marks=pytest.mark.slow),
        pytest.param(BENCHES["bench"], {}, id="bench-nothing", marks=pytest.mark.slow),
    ],
)
def test_what_is_hidden_is_named_without_periods(machine, hidden):
    rig = machine.rig
    chips = np.random.default_rng(3).choice([-1.0, 1.0], (1500, len(rig.axes)))
    made = simulate(rig, np.repeat(chips, 4, axis=0), hidden, seed=4, **machine.truth)
    record = Record.from_arrays(
        y=made.y, i_e=made.i_e, i_c=made.i_c, sample_rate=rig.sample_rate, axes=rig.axes, rig=rig
    )
    assert record.period is None
    found = diagnose(rig, record)
    assert found.verdict == ("explained" if hidden else "adequate")
    assert set(found.effects) == set(hidden)
    assert found.history[-1].misfit == pytest.approx(1.0, abs=0.04)
    assert "no_periods" in {own.code for own in found.findings}


def levitator(effects=()):
    """Frequency response of the plant of a voltage-driven levitator from u to y and i_c, at 1 .. 40 Hz."""
    model = Model(Rig.from_toml(LEVITATOR))
    for effect, values in effects:
        model = model.add(effect, values)
    values = {slot: p.value for p in model.parameters for slot in p.slots}
    s = 2j * np.pi * np.linspace(1.0, 40.0, 20)
    response = frequency_response(open_plant(model.rig, model.effects).closed(values), s)[:, :, 0]
    return model, s, response[:, 0], response[:, 1]


def test_a_voltage_driven_coil_has_a_resistance_and_no_lag_of_the_force():
    model, s, y, i = levitator()
    assert model.names == ("K_i.A_zeta", "K_s.A_zeta", "R.A_zeta")
    current = 1.0 / 200.0 / (1.0 + 1e-5 * s)
    assert_allclose(i, current, rtol=1e-12)
    assert_allclose(y, 0.25 * current / (1e-3 * s**2 - 2.5), rtol=1e-10)


def test_inductance_and_back_emf_obey_the_coil_equation():
    _, s, y, i = levitator([("amplifier_bandwidth", {"inductance": 0.3}), ("back_emf", {"voltage_per_velocity": 0.2})])
    motion = 0.25 / (1e-3 * s**2 - 2.5)  # y per current
    current = 1.0 / (0.3 * s + 200.0 + 0.2 * s * motion)
    assert_allclose(i, current, rtol=1e-9)
    assert_allclose(y, motion * current, rtol=1e-9)


def test_early_y_and_late_i_are_shifts_in_time():
    """From where y is read, commands come later, and i_c is read later still."""
    late, early = 1e-4, 1.5e-3
    coil = ("amplifier_bandwidth", {"inductance": 0.3})
    _, _, y, i = levitator([coil])
    skew = (SamplingSkew(moves_y=True), {"current_late": late, "displacement_early": early})
    model, _, y_read, i_read = levitator([coil, skew])
    assert_allclose((y_read, i_read), (y, i), rtol=1e-12)  # the physics is the same
    plant = open_plant(model.rig, model.effects)
    assert plant.late == "sampling_skew.displacement_early"
    read = {own.slot: (own.output, own.scale) for own in plant.late_outputs}
    assert read == {f"sampling_skew.{time}": ("i_c.A_zeta", -1.0) for time in ("current_late", "displacement_early")}


def test_r_is_found_beside_k_i_and_k_s():
    rig = Rig.from_toml(LEVITATOR)
    truth = Model(rig).with_values({"R.A_zeta": 212.0, "K_i.A_zeta": 0.27, "K_s.A_zeta": 2.2})
    u = np.random.default_rng(5).uniform(-1.0, 1.0, (3000, 1))
    record = truth.virtual_experiment(u, sensor_noise=1e-6, current_noise=5e-5, seed=6)
    found = ambid.identify(rig, record).parameters
    for name, value in {"R.A_zeta": 212.0, "K_i.A_zeta": 0.27, "K_s.A_zeta": 2.2}.items():
        low, high = found[name].ci95
        assert low < value < high


def test_has_lag_and_time_constant_exclude_each_other():
    with pytest.raises(ambid.RigError, match="has_lag = false"):
        Rig.from_toml(LEVITATOR.replace("has_lag = false", "has_lag = false\ntime_constant = 1e-3"))
    with pytest.raises(ambid.RigError, match="has_lag = false"):
        Rig.from_toml(LEVITATOR.replace("has_lag = false", ""))


def test_the_rig_of_an_identified_model_has_its_values():
    rig = Rig.from_toml(LEVITATOR)
    tuned = Model(rig).with_values({"R.A_zeta": 212.0, "K_i.A_zeta": 0.27, "K_s.A_zeta": 2.2}).to_rig()
    assert Rig.from_toml(tuned.to_toml()) == tuned
    assert (tuned.amplifier.resistance, tuned.bearings[0].force_current) == (212.0, (0.27,))


def test_long_records_keep_the_lowest_lines_and_ever_fewer_above():
    lines = np.arange(1, 500_000)
    kept = thinned(lines, 16_384)
    assert 0.97 * 16_384 < len(kept) <= 16_384
    gaps = np.diff(kept)
    first = int(np.argmax(gaps > 1))
    assert (gaps[:first] == 1).all()
    assert first > 2000
    spread = gaps[first:] / kept[first:-1]  # even over the logarithm of frequency, but for whole lines
    assert (gaps[first:] >= 1).all()
    assert (spread * first < 2.1).all()
    assert (thinned(lines[:16_384], 16_384) == lines[:16_384]).all()


def test_lines_that_are_left_out_are_found():
    rig = Rig.load(DATA / "rig.toml")
    ones = np.ones((40_000, len(rig.axes)))
    record = replace(Model(rig).simulate(ones), period=None)
    *others, shown = findings_of(record)
    assert (shown.code, shown.values["frequencies"]) == ("frequencies_thinned", 19_999)
    assert shown.values["judged"] < 16_384
    assert list(findings_of(replace(record, y=ones[:30_000], i_c=ones[:30_000], i_e=ones[:30_000]))) == others
