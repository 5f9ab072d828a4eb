"""The check of rigs and records: one thing wrong at a time must be named, physics that is hidden must not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ambid.checking import check, stops_diagnosis
from ambid.excitation import multisine, prbs
from ambid.findings import REMARK, Where
from ambid.model import Model
from ambid.rig import Rig
from hidden.bench import simulate
from hidden.experiment import experiment
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from places import LEVITATOR
from reference.loop_rigs import RIGS
from virtual import VirtualBench

EXCHANGED, TURNED = [2, 3, 0, 1], [1, 0, 3, 2]
HIDDEN = [
    "rotor_inertia_error",
    "seal_forces",
    "force_nonlinearity",
    "flux_saturation",
    "amplifier_bandwidth",
    "amplifier_voltage_limit",
    "loop_delay",
    "sensor_gain_error",
    "sampling_skew",
    "back_emf",
]
HIDDEN_FAST = {"seal_forces", "force_nonlinearity", "loop_delay", "sensor_gain_error"}
"""Of these the others are variations: of the rotor, the force, the controller's path, and a sensor."""
KINDS = ["digital", "other_rotor", "gravity", "without_i_c", "two_amplitudes", "turning"]


@cache
def bench_experiment():
    """A bench and one record of it, with nothing hidden."""
    rig, (record,), _, _ = experiment(None)
    return rig, record


@cache
def mass_experiment():
    """A mass on one axis and a record of it, with nothing hidden."""
    own = ONE_AXIS
    return own.rig, simulate(
        own.rig, own.excitation(own.amplitude), {}, seed=1, period=own.period, **own.truth, **own.noise
    )


def with_gains(rig, **factors):
    changed = {key: factor * getattr(rig.controller, key) for key, factor in factors.items()}
    return rig.replace(controller=rig.controller.model_copy(update=changed))


def only_error(rig, record, code, *, stops=False, **values):
    """The one error that is found, of this kind and with these values."""
    (error,) = check(rig, [record]).errors
    assert error.code == code
    assert stops_diagnosis(error) == stops
    assert error.remedy
    assert {key: error.values[key] for key in values} == values
    return error


def wrong_gain(rig, record):
    """The factors of the one error that is found, which is a matter of degree: a diagnosis ranks it beside physics."""
    error = only_error(rig, record, "gains_differ")
    factors = error.values["factors"]
    ranked = {"excitation_gain_error": "i_e" in factors, "controller_gain_error": set(factors) != {"i_e"}}
    assert error.values["ranked"] == [name for name, is_one in ranked.items() if is_one]
    return factors


def warnings_of(rig, *records):
    soundness = check(rig, records)
    assert soundness.is_sound, soundness.errors
    return [found for found in soundness.findings if found.severity == "warning"]


def codes(findings):
    return [found.code for found in findings]


@pytest.mark.parametrize(
    "effect", [own if own in HIDDEN_FAST else pytest.param(own, marks=pytest.mark.slow) for own in HIDDEN]
)
def test_hidden_physics_is_no_error(effect):
    rig, train, validate, _ = experiment(effect, "large")
    records = [*train, *validate]
    assert warnings_of(rig, *records) == []
    assert warnings_of(rig, *(replace(record, i_c=None) for record in records)) == []


@pytest.mark.parametrize("kind", KINDS)
def test_other_sound_records(kind):
    rig, train, validate, _ = experiment(None, kind=kind)
    assert warnings_of(rig, *train, *validate) == []


@pytest.mark.parametrize("off", [0.0, 0.1, 0.2])
def test_nominal_values_may_be_off(off, run):
    assert warnings_of(VirtualBench().rig(off), run) == []


@pytest.mark.parametrize("name", RIGS)
def test_sound_rigs_of_many_kinds(name):
    rig = RIGS[name]
    excitation = multisine(8000, rms=0.05, band_hz=(4.0, 2000.0), sample_rate=1e4, axes=len(rig.axes), periods=4)
    record = replace(Model(rig).virtual_experiment(excitation, seed=1), period=8000)
    assert check(rig, [record, replace(record, i_c=None)]).is_sound


def test_one_excited_axis_is_enough():
    rig, _ = bench_experiment()
    excitation = multisine(5000, rms=0.1, band_hz=(4.0, 1500.0), sample_rate=1e4, axes=4, periods=4)
    excitation[:, 1:] = 0.0
    record = replace(Model(rig).virtual_experiment(excitation, seed=1), period=5000)
    assert warnings_of(rig, record, replace(record, i_c=None)) == []
    factors = wrong_gain(with_gains(rig, derivative=0.7), record)
    assert factors == {"derivative": pytest.approx(1.0 / 0.7, rel=0.02)}


@pytest.mark.parametrize("amplitude", [0.1, 0.01, 0.001])
def test_noise_is_no_fault(amplitude):
    rig, record = mass_experiment()
    noisy = Model(rig).virtual_experiment(amplitude * np.sign(record.i_e), seed=4)
    noisy = replace(noisy, period=record.period)
    assert check(rig, [noisy, replace(noisy, i_c=None)]).is_sound


def test_wrong_gains_of_the_controller_are_told():
    rig, record = mass_experiment()
    factors = wrong_gain(with_gains(rig, proportional=1.3, derivative=0.7), record)
    expected = {"proportional": 1.0 / 1.3, "derivative": 1.0 / 0.7}
    assert factors == pytest.approx(expected, rel=0.01)  # and nothing of the integral
    (warning,) = warnings_of(with_gains(rig, proportional=1.07), record)
    assert (warning.code, warning.where.record, warning.where.key) == ("gains_differ", record.name, "controller")
    assert warning.values["factors"] == pytest.approx({"proportional": 1.0 / 1.07}, rel=0.01)


@pytest.mark.parametrize("signal", ["i_e", "y", "i_c"])
@pytest.mark.parametrize("order", [EXCHANGED, TURNED])
def test_columns_of_one_signal_in_a_wrong_order(signal, order):
    rig, record = bench_experiment()
    error = only_error(rig, replace(record, **{signal: getattr(record, signal)[:, order]}), "channels_exchanged")
    assert (error.where.record, error.where.channel) == ("train", signal)
    renamed = dict(zip(error.values["axes"], error.values["columns"], strict=True))
    assert renamed == {rig.axes[j]: rig.axes[k] for j, k in enumerate(order)}


def test_exchanged_bearings_are_a_warning():
    rig, record = bench_experiment()
    swapped = replace(record, **{s: getattr(record, s)[:, EXCHANGED] for s in ("i_e", "y", "i_c")})
    (warning,) = warnings_of(rig, swapped)
    assert warning.code == "axes_exchanged"
    assert warning.values["columns"] == [rig.axes[k] for k in EXCHANGED]
    assert warning.values["axes"] == list(rig.axes)
    assert "axes_exchanged" in codes(warnings_of(rig, replace(swapped, i_c=None)))


@pytest.mark.parametrize(("signal", "factor", "unit"), [("i_c", 1e3, "mA"), ("i_e", 1e3, "mA"), ("y", 1e-3, None)])
def test_units(signal, factor, unit):
    rig, record = mass_experiment()
    wrong = replace(record, **{signal: factor * getattr(record, signal)})
    only_error(rig, wrong, "wrong_unit", signal=signal, factor=factor, unit=unit, axes=list(rig.axes))


@pytest.mark.parametrize("signal", ["y", "i_c", "i_e"])
def test_signs(signal):
    rig, record = mass_experiment()
    only_error(rig, replace(record, **{signal: -getattr(record, signal)}), "opposite_sign", signals=[signal])


@pytest.mark.parametrize("factor", [pytest.param(own, marks=pytest.mark.slow) for own in (0.8, 1.25, 1.3)])
def test_a_scale_of_the_excitation_is_a_matter_of_degree(factor):
    rig, record = bench_experiment()
    factors = wrong_gain(rig, replace(record, i_e=factor * record.i_e))
    assert factors == {"i_e": pytest.approx(1.0 / factor, rel=0.01)}


@pytest.mark.parametrize("signal", ["i_e", "y", "i_c"])
def test_a_scale_of_one_axis_names_it(signal):
    rig, record = bench_experiment()
    scaled = getattr(record, signal) * [1.0, 1.0, 0.9, 1.0]
    findings = check(rig, [replace(record, **{signal: scaled})]).findings
    (found,) = [own for own in findings if own.code == "gains_differ"]
    assert all(set(own) == {rig.axes[2]} for own in found.values["factors"].values())
    assert (found.values["channel"], found.values["axes"]) == (signal, [rig.axes[2]])


def test_a_gain_beyond_all_degrees():
    rig, record = mass_experiment()
    error = only_error(rig, replace(record, i_e=0.05 * record.i_e), "gains_beyond_range")
    assert error.values["factors"] == {"i_e": pytest.approx(20.0, rel=0.02)}


@pytest.mark.slow
def test_a_current_without_the_excitation():
    """The controller's command, before i_e joins it and before the amplifier."""
    rig, record = bench_experiment()
    tau = rig.amplifier.time_constant
    lag = 1.0 + 2j * np.pi * tau * np.fft.rfftfreq(record.samples, 1.0 / record.sample_rate)[:, None]
    command = np.fft.irfft(lag * np.fft.rfft(record.i_c, axis=0), n=record.samples, axis=0) - record.i_e
    error = only_error(rig, replace(record, i_c=command), "current_without_excitation")
    assert "i_e" in error.values["factors"]


def test_the_sign_of_one_sensor():
    rig, record = bench_experiment()
    only_error(rig, replace(record, y=record.y * [1, 1, -1, 1]), "opposite_sign", signals=["y"], axes=["B_zeta"])


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mm"), (1e6, "um")])
@pytest.mark.parametrize("with_i_c", [True, False])
def test_displacement_in_a_small_unit(factor, unit, with_i_c):
    rig, record = mass_experiment()
    record = replace(record, y=factor * record.y, i_c=record.i_c if with_i_c else None)
    found = {own.code: own for own in check(rig, [record]).findings}
    assert found["travel_beyond_gap"].values["air_gap_m"] == rig.bearings[0].air_gap
    assert found["wrong_unit"].values["unit"] == unit
    assert not stops_diagnosis(found["wrong_unit"])


@pytest.mark.parametrize("with_i_c", [True, False])
def test_excitation_of_another_record(with_i_c):
    rig, record = bench_experiment()
    record = record if with_i_c else replace(record, i_c=None)
    shifted = only_error(rig, replace(record, i_e=np.roll(record.i_e, 700, axis=0)), "excitation_shifted")
    assert shifted.values["shift_samples"] == pytest.approx(-700, abs=5)  # to earlier times
    random = np.random.default_rng(0).choice([-1.0, 1.0], (record.period, len(rig.axes)))
    other = only_error(rig, replace(record, i_e=np.tile(random, (record.periods, 1))), "foreign_excitation", stops=True)
    assert (other.where.record, other.where.channel) == ("train", "i_e")


def test_without_i_c_the_nominal_loop_is_the_measure():
    rig, record = bench_experiment()
    record = replace(record, i_c=None)
    error = only_error(rig, replace(record, y=record.y[:, EXCHANGED]), "excitation_axes_exchanged")
    assert error.values["axes"] == list(rig.axes)
    only_error(rig, replace(record, y=-record.y), "opposite_sign", signals=["y"])
    (warning,) = warnings_of(with_gains(rig, proportional=1.3, derivative=0.7), record)
    assert (warning.code, warning.values["model"]) == ("plant_differs", "loop")


def test_a_record_of_another_rig():
    """The small spindle's rig under the bench's names and rate; then its machine alone, held to the bench's current."""
    rig, record = bench_experiment()
    small, *_ = experiment(None, kind="other_rotor")
    names = [b.model_copy(update={"name": name}) for b, name in zip(small.bearings, "AB", strict=True)]
    other = small.replace(sample_rate=rig.sample_rate, bearings=names)
    gains, machine = check(other, [record]).errors
    assert (gains.code, machine.code) == ("gains_differ", "other_machine")
    assert gains.values["factors"]["proportional"] == pytest.approx(1.89, abs=0.01)
    assert machine.values["model"] == "machine"
    assert not any(map(stops_diagnosis, (gains, machine)))
    only_error(other, replace(record, i_c=None), "other_machine", model="loop")


def test_a_force_that_is_too_small_is_physics_or_a_value_where_the_controller_is_the_rigs():
    """The bench's rig with twice its K_i; with 0.4 of it, which no physics does."""
    rig, record = bench_experiment()

    def shown(own, factor):
        scaled = [{"force_current": tuple(factor * k for k in b.force_current)} for b in own.bearings]
        bearings = [b.model_copy(update=update) for b, update in zip(own.bearings, scaled, strict=True)]
        found = check(own.replace(bearings=bearings), [record]).findings
        (machine,) = [f for f in found if f.values.get("cause") == "i_c"]
        return machine.code, machine.severity, stops_diagnosis(machine)

    assert shown(rig, 380.0 / 180.0) == ("force_too_small", "warning", False)
    assert shown(rig, 0.4) == ("other_machine", "error", False)


def test_axes_and_rate_of_another_rig():
    rig, record = bench_experiment()
    axes = ("X_zeta", "X_eta", "B_zeta", "B_eta")
    only_error(rig, replace(record, axes=axes), "axes_differ", stops=True, axes=list(axes), rig_axes=list(rig.axes))
    only_error(rig, replace(record, sample_rate=2e4), "sample_rate_differs", stops=True, sample_rate_hz=2e4)


def test_no_excitation():
    rig, record = mass_experiment()
    only_error(rig, replace(record, i_e=None), "excitation_not_logged", stops=True)
    only_error(rig, replace(record, i_e=0.0 * record.i_e), "no_excitation", stops=True, signals=["i_e"])


def test_excitation_beyond_the_lines_that_count():
    rig, record = bench_experiment()
    fast = multisine(5115, rms=0.1, band_hz=(3000.0, 4000.0), sample_rate=1e4, axes=4, periods=4)
    assert codes(warnings_of(rig, replace(record, i_e=fast))) == ["no_excited_lines"]


@pytest.mark.parametrize(
    ("periods", "code"), [(0, "period_not_found"), (1, "one_period"), (2, "few_periods"), (3, "few_periods"), (4, None)]
)
def test_too_few_periods(periods, code):
    rig, record = mass_experiment()
    cut = {s: getattr(record, s)[: max(periods, 1) * record.period] for s in ("i_e", "y", "i_c")}
    soundness = check(rig, [replace(record, **cut, period=record.period if periods else None)])
    assert soundness.is_sound
    found = [own for own in soundness.findings if "period" in own.code]
    assert codes(found) == ([] if code is None else [code])
    assert all(stops_diagnosis(own) == (periods == 1) for own in found)


def test_a_slow_transient_is_nothing_to_tell():
    """It is fitted with every model, even where it outlasts half of the periods."""
    rig, _ = bench_experiment()
    excitation = multisine(500, rms=0.05, band_hz=(20.0, 1500.0), sample_rate=1e4, axes=4, periods=20)
    record = replace(Model(rig).virtual_experiment(excitation, seed=1), period=500)
    assert not [finding for finding in check(rig, [record]).findings if finding.where.record]


def test_travel_and_bias_current():
    rig, record = bench_experiment()
    offset = replace(record, y=record.y + 3e-4, i_c=record.i_c + 7.0)
    travel, current = warnings_of(rig, offset)
    assert (travel.code, current.code) == ("large_travel", "mean_current_off_bias")
    assert current.values["difference"] == pytest.approx(7.0 / 6.0 - 1.0, abs=0.01)
    assert current.values["bias_a"] == 6.0
    factor = 7.0 / np.abs(record.i_c).max()
    large = replace(record, i_e=factor * record.i_e, y=factor * record.y, i_c=factor * record.i_c)
    assert "current_beyond_bias" in codes(warnings_of(rig, large))


def test_an_absolute_gap_is_held_about_its_mean():
    rig, record = bench_experiment()
    gap = rig.bearings[0].air_gap
    absolute = replace(record, y=record.y - gap)
    assert warnings_of(rig, absolute) == []
    (figures,) = check(rig, [absolute]).records
    assert figures.share_of_gap == pytest.approx(np.abs(record.y - record.y.mean(axis=0)).max() / gap)


@pytest.mark.parametrize("severity", ["note", "warning"])
def test_findings_of_a_record_are_passed_on_with_its_name(severity):
    rig, record = bench_experiment()
    found = check(rig, [replace(record, findings=(REMARK(severity=severity, text="t jitters"),))]).findings
    assert REMARK(Where(record="train"), severity=severity, text="t jitters") in found


def test_unstable_rigs():
    rig, _ = bench_experiment()
    (error,) = check(with_gains(rig, proportional=0.3)).errors
    assert (error.code, error.where.key) == ("unstable_nominal_loop", "controller")
    assert error.values["frequency_hz"] == pytest.approx(7.13, abs=0.01)
    assert error.values["growth_per_s"] > 0.0
    assert (error.values["mode"], error.values["bending_mode"]) == ("rigid-body", None)
    stiff = [b.model_copy(update={"force_displacement": (2.35 * b.force_displacement[0],) * 2}) for b in rig.bearings]
    assert "stable_with_other_force_current" in codes(warnings_of(rig.replace(bearings=stiff)))


def test_magnets_and_sample_rate():
    rig, _ = bench_experiment()
    wide = rig.replace(bearings=[b.model_copy(update={"air_gap": 5e-3}) for b in rig.bearings])
    found = warnings_of(wide)
    assert [(own.code, own.where.axis) for own in found] == [("magnets_inconsistent", axis) for axis in rig.axes]
    slow = {own.code: own for own in warnings_of(rig.replace(sample_rate=3000.0))}
    assert slow["sample_rate_low_for_mode"].values["frequency_hz"] == pytest.approx(1383.0, abs=1.0)
    assert "sample_rate_low_for_loop" in slow


@pytest.mark.parametrize(
    "path", [lambda n: np.linspace(0.0, 1.0, n), lambda n: 1.0 - np.cos(np.linspace(0.0, 6.28, n))]
)
def test_a_set_point_that_ramps_is_an_operating_point_and_no_drift(path):
    rig, record = bench_experiment()
    own = path(record.samples)[:, None]
    moved = replace(record, y=record.y + 10.0 * record.y.std(axis=0) * own)
    assert "operating_point_drift" in codes(check(rig, [moved]).findings)


def test_a_drive_without_stiffness_is_a_warning():
    rig, _ = bench_experiment()
    drives = [b.model_copy(update={"force_displacement": (0.05,) * len(b.axes)}) for b in rig.bearings]
    drive = type(rig).from_toml(rig.replace(bearings=drives).to_toml())
    assert "magnets_inconsistent" in codes(check(drive).findings)


@pytest.mark.parametrize("seed", range(3))
def test_a_short_record_does_not_tell_the_integral(seed):
    """Two periods of 127 samples after the first: what noise has left in the integral is no wrong gain."""
    own = BENCHES["small"]
    i_e = prbs(7, amplitude=own.amplitude, hold=1, axes=len(own.rig.axes), periods=3)
    resonant = [1.0], [1.0, -2.0 * 0.98 * np.cos(0.8), 0.98**2]
    record = simulate(own.rig, i_e, seed=seed, period=127, colour=resonant, **own.truth, **own.noise)
    assert not [finding for finding in check(own.rig, [record]).findings if finding.code == "gains_differ"]


@pytest.mark.parametrize("seed", range(3))
def test_a_gain_that_a_short_weak_record_does_not_determine_is_no_slip(seed):
    """An integral makes half a per cent of i_c here; noise that is held over a sample is taken for six of it."""
    rig = Rig.load(LEVITATOR)
    i_e = 0.1 * np.random.default_rng(100 + seed).standard_normal((3000, 1))
    record = Model(rig).virtual_experiment(i_e, sensor_noise=2e-7, current_noise=5e-3, seed=seed)
    findings = check(rig, [record]).findings
    assert not [finding for finding in findings if stops_diagnosis(finding)]
