"""The check of rigs and records: one thing wrong at a time must be named, physics that is hidden must not."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ambid.checking import check
from ambid.excitation import multisine, prbs
from ambid.model import Model
from ambid.rig import Rig
from ambid.rig.controller import PID_GAINS
from hidden.bench import simulate
from hidden.experiment import experiment
from hidden.families import BENCHES
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
KINDS = ["digital", "other_rotor", "gravity", "without_i_c", "two_amplitudes", "turning"]


@cache
def bench_experiment():
    """A bench and one record of it, with nothing hidden."""
    rig, (record,), _, _ = experiment(None)
    return rig, record


def with_gains(rig, **factors):
    changed = {key: factor * getattr(rig.controller, key) for key, factor in factors.items()}
    return rig.replace(controller=rig.controller.model_copy(update=changed))


def only_fault(rig, record, *, stops=True):
    """The one fault that is found, as text."""
    faults = check(rig, [record]).faults
    assert len(faults) == 1, faults
    assert faults[0].stops_diagnosis == stops
    assert faults[0].todo
    return f"{faults[0].where}: {faults[0].what}"


def wrong_gain(rig, record):
    """The one fault that is found, which is a matter of degree: a diagnosis ranks it beside the physics."""
    text = only_fault(rig, record, stops=False)
    (fault,) = check(rig, [record]).faults
    assert ("controller_gain_error" in fault.todo) == any(f"{gain} x" in text for gain in PID_GAINS)
    assert ("excitation_gain_error" in fault.todo) == ("i_e x" in text)
    return text


def warnings_of(rig, *records):
    soundness = check(rig, records)
    assert soundness.is_sound, soundness.faults
    return [f"{f.where}: {f.what}" for f in soundness.findings if f.severity == "warning"]


@pytest.mark.parametrize("effect", HIDDEN)
def test_hidden_physics_is_no_fault(effect):
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
    assert "derivative x 1.4" in wrong_gain(with_gains(rig, derivative=0.7), record)


@pytest.mark.parametrize("amplitude", [0.1, 0.01, 0.001])
def test_noise_is_no_fault(amplitude):
    rig, record = bench_experiment()
    noisy = Model(rig).virtual_experiment(amplitude * np.sign(record.i_e), seed=4)
    noisy = replace(noisy, period=record.period)
    assert check(rig, [noisy, replace(noisy, i_c=None)]).is_sound


def test_wrong_gains_of_the_controller_are_told():
    rig, record = bench_experiment()
    text = wrong_gain(with_gains(rig, proportional=1.3, derivative=0.7), record)
    assert text.startswith("train: controller")
    assert "proportional x 0.769" in text
    assert "derivative x 1.43" in text
    assert "integral" not in text
    (warning,) = warnings_of(with_gains(rig, proportional=1.07), record)
    assert "proportional x 0.93" in warning


@pytest.mark.parametrize("signal", ["i_e", "y", "i_c"])
@pytest.mark.parametrize("order", [EXCHANGED, TURNED])
def test_columns_of_one_signal_in_a_wrong_order(signal, order):
    rig, record = bench_experiment()
    text = only_fault(rig, replace(record, **{signal: getattr(record, signal)[:, order]}))
    assert text.startswith(f"train: {signal}: ")
    assert f"{rig.axes[order[0]]} as {rig.axes[0]}" in text


def test_exchanged_bearings_are_a_warning():
    rig, record = bench_experiment()
    swapped = replace(record, **{s: getattr(record, s)[:, EXCHANGED] for s in ("i_e", "y", "i_c")})
    (warning,) = warnings_of(rig, swapped)
    assert "B_zeta as A_zeta, B_eta as A_eta" in warning
    assert any("B_zeta as A_zeta" in text for text in warnings_of(rig, replace(swapped, i_c=None)))


@pytest.mark.parametrize(
    ("signal", "factor", "expected"),
    [
        ("i_c", 1e3, "1000 times too large for the controller's equation: it looks like mA"),
        ("i_e", 1e3, "1000 times too large for the controller's equation: it looks like mA"),
        ("y", 1e-3, "1000 times too small"),
        ("y", -1.0, "the sign is opposite"),
        ("i_c", -1.0, "the sign is opposite"),
        ("i_e", -1.0, "the sign is opposite"),
    ],
)
def test_units_and_signs(signal, factor, expected):
    rig, record = bench_experiment()
    text = only_fault(rig, replace(record, **{signal: factor * getattr(record, signal)}))
    assert expected in text
    assert f"{signal} " in text


@pytest.mark.parametrize(("factor", "expected"), [(1.3, "i_e x 0.769"), (0.8, "i_e x 1.25"), (1.25, "i_e x 0.8 ")])
def test_a_scale_of_the_excitation_is_a_matter_of_degree(factor, expected):
    rig, record = bench_experiment()
    text = wrong_gain(rig, replace(record, i_e=factor * record.i_e))
    assert expected in text
    assert "proportional" not in text


@pytest.mark.parametrize("signal", ["i_e", "y", "i_c"])
def test_a_scale_of_one_axis_names_it(signal):
    rig, record = bench_experiment()
    scaled = getattr(record, signal) * [1.0, 1.0, 0.9, 1.0]
    (found,) = [own for own in check(rig, [replace(record, **{signal: scaled})]).findings if "i_c follows" in own.what]
    assert f" on {rig.axes[2]}" in found.what
    assert not [axis for axis in rig.axes if axis != rig.axes[2] and axis in found.what]
    assert found.todo.startswith(f"check the scale of {signal} on {rig.axes[2]};")


def test_a_gain_beyond_all_degrees_stops():
    rig, record = bench_experiment()
    assert "i_e x 20" in only_fault(rig, replace(record, i_e=0.05 * record.i_e))


def test_a_current_without_the_excitation():
    """The controller's command, before i_e joins it and before the amplifier."""
    rig, record = bench_experiment()
    tau = rig.amplifier.time_constant
    lag = 1.0 + 2j * np.pi * tau * np.fft.rfftfreq(record.samples, 1.0 / record.sample_rate)[:, None]
    command = np.fft.irfft(lag * np.fft.rfft(record.i_c, axis=0), n=record.samples, axis=0) - record.i_e
    (fault,) = check(rig, [replace(record, i_c=command)]).faults
    assert "i_e x " in fault.what
    assert "recorded before i_e is added" in fault.todo


def test_the_sign_of_one_sensor():
    rig, record = bench_experiment()
    assert only_fault(rig, replace(record, y=record.y * [1, 1, -1, 1])).startswith("train: y on B_zeta: the sign")


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mm"), (1e6, "um")])
@pytest.mark.parametrize("with_i_c", [True, False])
def test_displacement_in_a_small_unit(factor, unit, with_i_c):
    rig, record = bench_experiment()
    record = replace(record, y=factor * record.y, i_c=record.i_c if with_i_c else None)
    found = check(rig, [record])
    assert any("the air gap is 0.0005 m" in finding.what for finding in found.findings)
    assert any(f"it looks like {unit}" in fault.what and fault.stops_diagnosis for fault in found.faults)


@pytest.mark.parametrize("with_i_c", [True, False])
def test_excitation_of_another_record(with_i_c):
    rig, record = bench_experiment()
    record = record if with_i_c else replace(record, i_c=None)
    shifted = only_fault(rig, replace(record, i_e=np.roll(record.i_e, 700, axis=0)))
    assert "samples" in shifted
    assert "to earlier times" in shifted
    random = np.random.default_rng(0).choice([-1.0, 1.0], (record.period, 4))
    other = only_fault(rig, replace(record, i_e=np.tile(random, (record.periods, 1))))
    assert other.startswith("train: i_e")
    assert "seems to belong to another record" in other


def test_without_i_c_the_nominal_loop_is_the_measure():
    rig, record = bench_experiment()
    record = replace(record, i_c=None)
    assert "B_zeta as A_zeta" in only_fault(rig, replace(record, y=record.y[:, EXCHANGED]))
    assert "the sign is opposite" in only_fault(rig, replace(record, y=-record.y))
    (warning,) = warnings_of(with_gains(rig, proportional=1.3, derivative=0.7), record)
    assert "as in the nominal loop" in warning


def test_a_record_of_another_rig():
    """The small spindle's rig under the bench's names and rate; then its machine alone, held to the bench's current."""
    rig, record = bench_experiment()
    small, *_ = experiment(None, kind="other_rotor")
    names = [b.model_copy(update={"name": name}) for b, name in zip(small.bearings, "AB", strict=True)]
    other = small.replace(sample_rate=rig.sample_rate, bearings=names)
    gains, machine = check(other, [record]).faults
    assert "proportional x 1.89" in gains.what
    assert "i_c as in the nominal machine" in machine.what
    assert [gains.stops_diagnosis, machine.stops_diagnosis] == [False, True]
    assert "as in the nominal loop" in only_fault(other, replace(record, i_c=None))


def test_a_force_that_is_too_small_is_physics_or_a_value_where_the_controller_is_the_rigs():
    """The bench's rig with twice its K_i; with 0.4 of it, which no physics does."""
    rig, record = bench_experiment()

    def told(own, factor):
        scaled = [{"force_current": tuple(factor * k for k in b.force_current)} for b in own.bearings]
        bearings = [b.model_copy(update=update) for b, update in zip(own.bearings, scaled, strict=True)]
        found = check(own.replace(bearings=bearings), [record]).findings
        (machine,) = [f for f in found if "i_c as in the nominal machine" in f.what]
        return machine.severity, machine.stops_diagnosis, "a dead band" in machine.todo

    assert told(rig, 380.0 / 180.0) == ("warning", False, True)
    assert told(rig, 0.4) == ("fault", True, False)


def test_axes_and_rate_of_another_rig():
    rig, record = bench_experiment()
    assert "X_zeta" in only_fault(rig, replace(record, axes=("X_zeta", "X_eta", "B_zeta", "B_eta")))
    assert "20000 Hz" in only_fault(rig, replace(record, sample_rate=2e4))


def test_no_excitation():
    rig, record = bench_experiment()
    assert "not logged" in only_fault(rig, replace(record, i_e=None))
    assert "no excitation" in only_fault(rig, replace(record, i_e=0.0 * record.i_e))


def test_excitation_beyond_the_lines_that_count():
    rig, record = bench_experiment()
    fast = multisine(5115, rms=0.1, band_hz=(3000.0, 4000.0), sample_rate=1e4, axes=4, periods=4)
    (warning,) = warnings_of(rig, replace(record, i_e=fast))
    assert "no line of i_e" in warning


@pytest.mark.parametrize(("periods", "stops"), [(0, False), (1, True), (2, False), (3, False), (4, None)])
def test_too_few_periods(periods, stops):
    rig, record = bench_experiment()
    cut = {s: getattr(record, s)[: max(periods, 1) * record.period] for s in ("i_e", "y", "i_c")}
    soundness = check(rig, [replace(record, **cut, period=record.period if periods else None)])
    assert soundness.is_sound
    assert [f.stops_diagnosis for f in soundness.findings if "period" in f.what] == ([] if stops is None else [stops])


def test_a_slow_transient_is_nothing_to_tell():
    """It is fitted with every model, even where it outlasts half of the periods."""
    rig, _ = bench_experiment()
    excitation = multisine(500, rms=0.05, band_hz=(20.0, 1500.0), sample_rate=1e4, axes=4, periods=20)
    record = replace(Model(rig).virtual_experiment(excitation, seed=1), period=500)
    assert not [finding for finding in check(rig, [record]).findings if finding.where.startswith(record.name)]


def test_travel_and_bias_current():
    rig, record = bench_experiment()
    offset = replace(record, y=record.y + 3e-4, i_c=record.i_c + 7.0)
    texts = warnings_of(rig, offset)
    assert any("more than half of the air gap" in text for text in texts)
    assert any("17 % above bias_current = 6 A, and reaches" in text for text in texts)
    factor = 7.0 / np.abs(record.i_c).max()
    large = replace(record, i_e=factor * record.i_e, y=factor * record.y, i_c=factor * record.i_c)
    assert any("more than the bias current of 6 A: a magnet cannot push" in text for text in warnings_of(rig, large))


def test_an_absolute_gap_is_held_about_its_mean():
    rig, record = bench_experiment()
    gap = rig.bearings[0].air_gap
    absolute = replace(record, y=record.y - gap)
    assert not any("air gap" in text for text in warnings_of(rig, absolute))
    (figures,) = check(rig, [absolute]).records
    assert figures.share_of_gap == pytest.approx(np.abs(record.y - record.y.mean(axis=0)).max() / gap)


def test_notes_of_a_record_are_warnings():
    rig, record = bench_experiment()
    assert warnings_of(rig, replace(record, notes=("t jitters",))) == ["train: t jitters"]


def test_unstable_rigs():
    rig, _ = bench_experiment()
    (fault,) = check(with_gains(rig, proportional=0.3)).faults
    assert fault.where == "controller"
    assert "unstable: a pole at 7.13 Hz grows with" in fault.what
    assert "it moves the rotor as a rigid body" in fault.what
    stiff = [b.model_copy(update={"force_displacement": (2.35 * b.force_displacement[0],) * 2}) for b in rig.bearings]
    assert any("stable with all K_i x" in warning for warning in warnings_of(rig.replace(bearings=stiff)))


def test_magnets_and_sample_rate():
    rig, _ = bench_experiment()
    wide = rig.replace(bearings=[b.model_copy(update={"air_gap": 5e-3}) for b in rig.bearings])
    assert [text.split(":")[0] for text in warnings_of(wide)] == [f"bearing.{axis}" for axis in rig.axes]
    texts = warnings_of(rig.replace(sample_rate=3000.0))
    assert any("the bending mode at 1383 Hz" in text for text in texts)
    assert any("bandwidth" in text for text in texts)


@pytest.mark.parametrize(
    "path", [lambda n: np.linspace(0.0, 1.0, n), lambda n: 1.0 - np.cos(np.linspace(0.0, 6.28, n))]
)
def test_a_set_point_that_ramps_is_an_operating_point_and_no_drift(path):
    rig, record = bench_experiment()
    own = path(record.samples)[:, None]
    moved = replace(record, y=record.y + 10.0 * record.y.std(axis=0) * own)
    assert any("passes through operating points, which is no drift" in f.what for f in check(rig, [moved]).findings)


def test_a_drive_without_stiffness_is_a_warning():
    rig, _ = bench_experiment()
    drives = [b.model_copy(update={"force_displacement": (0.05,) * len(b.axes)}) for b in rig.bearings]
    drive = type(rig).from_toml(rig.replace(bearings=drives).to_toml())
    assert any("1 for ideal magnets" in finding.what for finding in check(drive).findings)


def test_the_page_and_its_json():
    rig, record = bench_experiment()
    soundness = check(rig, [record, replace(record, name="turned", y=record.y[:, TURNED])])
    page = repr(soundness)
    assert len(page.splitlines()) < 50
    for text in ("69 kg", "553.8, 1383 Hz", "zone A of ISO 14839-3", "train: 20460 samples", "NOT SOUND: 1 fault"):
        assert text in page
    data = json.loads(json.dumps(soundness.to_json(), allow_nan=False))
    assert data["is_sound"] is False
    assert data["findings"][0]["severity"] == "fault"
    assert data["loop"]["mass"] == pytest.approx(69.0, rel=1e-3)
    assert len(data["records"]) == 2
    json.dumps(check(with_gains(rig, proportional=0.3)).to_json(), allow_nan=False)


def test_figures_of_the_loop():
    """A mass on one axis: the unstable pole and the peak sensitivity follow from one line of algebra."""
    rig = RIGS["analog, one axis"]
    figures = check(rig).loop
    (bearing,) = rig.bearings
    assert figures.mass == pytest.approx(2.0)
    assert figures.open_loop_unstable == pytest.approx([np.sqrt(bearing.force_displacement[0] / 2.0)])
    f = np.geomspace(1.0, 4000.0, 20000)
    s, pid = 2j * np.pi * f, rig.controller
    K = pid.proportional + pid.integral / s + pid.derivative * s / (pid.derivative_time_constant * s + 1)
    lags = (1 + s * rig.amplifier.time_constant) * (1 + s * rig.actuator.time_constant)
    G = bearing.force_current[0] / lags / (2.0 * s**2 - bearing.force_displacement[0])
    S = np.abs(1 / (1 + K * G))
    assert figures.peak_sensitivity == pytest.approx(S.max(), rel=1e-3)
    assert figures.peak_sensitivity_hz == pytest.approx(f[S.argmax()], rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_a_short_record_does_not_tell_the_integral(seed):
    """Two periods of 127 samples after the first: what noise has left in the integral is no wrong gain."""
    own = BENCHES["small"]
    i_e = prbs(7, amplitude=own.amplitude, hold=1, axes=len(own.rig.axes), periods=3)
    resonant = [1.0], [1.0, -2.0 * 0.98 * np.cos(0.8), 0.98**2]
    record = simulate(own.rig, i_e, seed=seed, period=127, colour=resonant, **own.truth, **own.noise)
    assert not [finding for finding in check(own.rig, [record]).findings if "follows from" in finding.what]


@pytest.mark.parametrize("seed", range(3))
def test_a_gain_that_a_short_weak_record_does_not_determine_is_no_slip(seed):
    """An integral makes half a per cent of i_c here; noise that is held over a sample is taken for six of it."""
    rig = Rig.load(LEVITATOR)
    i_e = 0.1 * np.random.default_rng(100 + seed).standard_normal((3000, 1))
    record = Model(rig).virtual_experiment(i_e, sensor_noise=2e-7, current_noise=5e-3, seed=seed)
    findings = check(rig, [record]).findings
    assert not [finding.what for finding in findings if finding.stops_diagnosis]
