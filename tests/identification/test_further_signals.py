"""Flux density, force, acceleration, further displacements: closed forms, and identification by virtual records."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from ambid.channels import SIGNALS, SensorSignal
from ambid.checking import check
from ambid.designs import Instruments, prospect
from ambid.diagnosis import diagnose
from ambid.errors import ModelError, RecordError
from ambid.identification import identify
from ambid.model import Model
from ambid.monte_carlo import Plan, run_monte_carlo
from ambid.noise import compare
from ambid.record import Record
from ambid.rig import Rig
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.machine import magnet
from hidden.network import library
from hidden.one_axis import ONE_AXIS
from validated import relative

MU_0 = 4e-7 * np.pi


def instrumented(bench, area, sensors, **more) -> Rig:
    """The rig of a bench with sensors; area and true bias flux of its poles are known."""
    data = bench.rig.model_dump(by_alias=True, exclude_none=True) | {"sensor": sensors} | more
    gains = iter(bench.K_i)
    for bearing in data["bearing"]:
        own = [next(gains) for _ in bearing["axes"]]
        flux = [float(np.sqrt(MU_0 * k_i * bearing["bias_current"] / (4.0 * area))) for k_i in own]
        bearing |= {"pole_area": area, "bias_flux": flux}
    return Rig(**data)


MASS = instrumented(ONE_AXIS, 3e-4, [{"signal": "a", "name": "mass"}, {"signal": "y", "name": "other"}])
NOISE = {"b.A_zeta": 2e-3, "f.A_zeta": 1.0, "a.mass": 0.1, "y.other": 1e-7}
"""White, of each instrument."""
BENCH = BENCHES["bench"]
SHAFT = instrumented(
    BENCH,
    5e-4,
    [
        {"signal": "a", "name": "middle", "position": 0.43, "direction": 30.0},
        {"signal": "y", "name": "middle_y", "position": 0.43, "direction": 30.0},
    ],
    speed=300.0,
)


def responses(model, frequency_hz):
    found = model.loop.frequency_response(model.theta, frequency_hz)
    return {name: found[:, k, 0] for k, name in enumerate(model.loop.outputs)}


def test_acceleration_is_the_second_derivative_with_gyroscopic_and_all_other_forces(validated):
    f = np.geomspace(5.0, 2e3, 40)
    seal = ("seal_forces", {"direct_stiffness": 3e5, "cross_stiffness": 2e5})
    seen = responses(Model(SHAFT).add(*seal).with_outputs(("a.middle", "y.middle_y")), f)
    validated(
        "Acceleration of a rotor with a seal that turns: relative error of its response",
        "-w^2 y at the same place",
        relative(seen["a.middle"], -((2.0 * np.pi * f) ** 2) * seen["y.middle_y"]),
        1e-9,
    )


def test_force_on_a_mass_is_mass_times_acceleration_and_flux_goes_with_it(validated):
    f = np.geomspace(5.0, 2e3, 40)
    seen = responses(Model(MASS).add("eddy_currents").with_outputs(("a", "f", "b")), f)
    np.testing.assert_allclose(seen["f.A_zeta"], 12.0 * seen["a.mass"], rtol=1e-9)
    gain = 2.0 * 3e-4 * MASS.bearings[0].bias_flux[0] / MU_0
    validated(
        "Flux density of a Hall sensor with eddy currents: relative error of its response",
        "f = 2 A B_0 b / mu_0 (opposed poles)",
        relative(gain * seen["b.A_zeta"], seen["f.A_zeta"]),
        1e-9,
    )


def test_voltage_drives_resistance_inductance_and_back_emf(validated):
    coil = MASS.replace(
        amplifier={"time_constant": 1e-3, "resistance": 2.0},
        controller=MASS.controller.model_copy(update={"proportional": 6e4, "integral": 1e5, "derivative": 150.0}),
    )
    f = np.geomspace(5.0, 2e3, 40)
    emf = ("back_emf", {"voltage_per_velocity": 20.0})
    seen = responses(Model(coil).add(*emf).with_outputs("u"), f)
    s = 2j * np.pi * f
    needed = 2.0 * (1.0 + 1e-3 * s) * seen["i_c.A_zeta"] + 20.0 * s * seen["y.A_zeta"]
    validated(
        "Coil voltage: relative error of its response",
        "u = R i + L di/dt + k dy/dt",
        relative(seen["u.A_zeta"], needed),
        1e-9,
    )


COIL = MASS.replace(amplifier={"time_constant": 1e-4, "coil_resistance": 2.0, "coil_inductance": 0.04})


def test_voltage_of_a_coil_whose_current_is_commanded_is_that_of_its_flux_linkage():
    f = np.geomspace(5.0, 2e3, 40)
    seen = responses(Model(COIL).add("amplifier_bandwidth").with_outputs("u"), f)
    s, K_i = 2j * np.pi * f, COIL.bearings[0].force_current[0]
    linkage = 0.04 * seen["i_c.A_zeta"] + K_i * seen["y.A_zeta"]
    np.testing.assert_allclose(seen["u.A_zeta"], 2.0 * seen["i_c.A_zeta"] + s * linkage, rtol=1e-9)


@pytest.mark.parametrize("with_i_c", [True, False])
def test_voltage_tells_resistance_and_inductance_and_stands_for_the_current(with_i_c):
    given = measured(COIL, ONE_AXIS.excitation(1.0), {}, seed=4, further={"u.A_zeta": 0.05}, **ONE_AXIS.truth)
    off = COIL.amplifier.model_copy(update={"coil_resistance": 1.8, "coil_inductance": 0.05})
    known = {"exact": False, "coil_resistance": 0.1, "coil_inductance": 0.3, "voltage_gain": 0.0}
    rig = COIL.replace(amplifier=off, tolerance=known)
    found = identify(rig, given if with_i_c else replace(given, i_c=None))
    assert found.is_adequate
    for name, wanted in {
        "coil_resistance.A_zeta": 2.0 / 1.8 - 1.0,
        "coil_inductance.A_zeta": 0.04 / 0.05 - 1.0,
    }.items():
        own = found.tolerances[name]
        assert abs(own.posterior_value - wanted) < 3.5 * own.posterior_std < 0.5 * abs(wanted), name
    for name, value in {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}.items():
        parameter = found.parameters[name]
        assert abs(parameter.value - value) < 3.5 * parameter.std_error, name


@pytest.fixture(scope="module")
def record():
    return measured(MASS, ONE_AXIS.excitation(1.0), {}, seed=1, further=NOISE, **ONE_AXIS.truth)


@pytest.mark.parametrize("channels", [[name] for name in NOISE] + [list(NOISE)])
@pytest.mark.parametrize("with_i_c", [True, False])
def test_one_axis(record, channels, with_i_c, validated):
    own = replace(record, further={name: record.further[name] for name in channels})
    found = identify(MASS, own if with_i_c else replace(own, i_c=None))
    truth = {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}
    assert found.misfit == pytest.approx(1.0, abs=0.08)
    parameters = [found.parameters[name] for name in truth]
    validated(
        "K_i, K_s, tau_e from flux density, force, acceleration or a further displacement: error in standard errors",
        "truth of the independent simulator in C",
        [(own.value - value) / own.std_error for own, value in zip(parameters, truth.values(), strict=True)],
        3.5,
    )


TILT = BENCH.rig.bearings[0].tilt
FOUR = instrumented(
    BENCH,
    5e-4,
    [
        {"signal": "a", "name": f"{place}_{axis}", "position": z, "direction": TILT + angle}
        for place, z in (("middle", 0.43), ("left", 0.2))
        for axis, angle in (("zeta", 0.0), ("eta", 90.0))
    ],
)


def without_y(record, rig) -> Record:
    """What a machine without displacement sensors on the recorder gives, by the gates."""
    return Record.from_arrays(
        i_e=record.i_e,
        i_c=record.i_c,
        further=record.further,
        axes=record.axes,
        sample_rate=record.sample_rate,
        rig=rig,
    )


@pytest.fixture(scope="module")
def shaken():
    noise = dict.fromkeys((sensor.channel for sensor in FOUR.sensors), 0.1)
    return measured(FOUR, BENCH.excitation(1.0), {}, seed=1, further=noise, **BENCH.truth)


def errors(found) -> np.ndarray:
    """Errors of all parameters, relative to the truth, and in standard errors."""
    truth = {f"{k}.{axis}": v for k in ("K_i", "K_s") for axis, v in zip(FOUR.axes, BENCH.truth[k], strict=True)}
    truth["tau_e"] = BENCH.truth["tau_e"]
    return np.array(
        [
            (found.parameters[name].value - value) / np.array([value, found.parameters[name].std_error])
            for name, value in truth.items()
        ]
    )


def test_accelerations_and_currents_without_displacements_give_all_parameters(shaken):
    own = without_y(shaken, FOUR)
    assert own.channels == [*(f"i_c.{axis}" for axis in FOUR.axes), *sorted(shaken.further)]
    found = identify(FOUR, own)
    assert found.is_adequate
    assert np.abs(errors(found)[:, 1]).max() < 3.5  # of nine standard normal ones once in 240
    assert found.fit_percent["average"] == np.mean([found.fit_percent[name] for name in own.channels])
    assert "displacement_not_recorded" in {finding.code for finding in check(FOUR, own).findings}


@pytest.mark.slow
def test_noise_that_the_controller_hears_is_in_the_intervals_without_y():
    noise = dict.fromkeys((sensor.channel for sensor in FOUR.sensors), 0.1)
    given = (measured(FOUR, BENCH.excitation(1.0), {}, seed=s, further=noise, **BENCH.truth) for s in range(11, 17))
    of_tau_e = [errors(identify(FOUR, without_y(own, FOUR)))[-1, 1] for own in given]
    assert np.sum(np.square(of_tau_e)) < 22.5  # chi-square of six, 0.001


def test_accelerations_alone_give_all_parameters_with_a_warning(shaken):
    own = without_y(replace(shaken, i_c=None), FOUR)
    codes = [finding.code for finding in own.findings if finding.severity == "warning"]
    assert codes == ["loop_noise_not_recorded"]
    assert np.abs(errors(identify(FOUR, own))[:, 0]).max() < 3e-3


def test_an_accelerometer_that_sees_one_plane_says_nothing_of_the_other(shaken):
    alone = replace(shaken, i_c=None, further={"a.middle_zeta": shaken.further["a.middle_zeta"]})
    own = without_y(alone, FOUR)
    found = diagnose(FOUR, own)
    assert found.verdict == "not_informative"
    assert "not_determined" in {finding.code for finding in found.findings}
    lost = identify(FOUR, own).directions
    assert {name for direction in lost for name in direction} == {f"{k}.{b}_eta" for k in ("K_i", "K_s") for b in "AB"}


def test_an_effect_is_named_by_an_accelerometer_and_a_current():
    hidden = {"eddy_currents": {"tau": 3e-5}}
    given = measured(MASS, ONE_AXIS.excitation(1.0), hidden, seed=2, further={"a.mass": 0.1}, **ONE_AXIS.truth)
    found = diagnose(MASS, without_y(given, MASS))
    assert found.effects == ("eddy_currents",)


@pytest.mark.parametrize("suffix", [".csv", ".mat"])
def test_a_file_without_y_is_read_where_sensors_of_their_own_were_recorded(shaken, tmp_path, suffix):
    own = without_y(shaken, FOUR)
    own.save(tmp_path / f"shaken{suffix}")
    again = Record.load(tmp_path / f"shaken{suffix}", FOUR)
    assert again.channels == own.channels
    np.testing.assert_allclose(again.outputs, own.outputs, rtol=1e-15)
    assert [finding.code for finding in again.findings] == ["displacement_not_recorded"]


def test_without_y_the_excitation_must_be_recorded(shaken):
    with pytest.raises(RecordError, match="neither i_e nor y"):
        without_y(replace(shaken, i_e=None), FOUR)


@pytest.mark.parametrize("signal", get_args(SensorSignal))
def test_whatever_a_sensor_may_read_is_identified_from(signal):
    channel, truth = f"{signal}.own", {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}
    rig = ONE_AXIS.rig.replace(sensors=[{"signal": signal, "name": "own"}], tolerance={})
    model, i_e = Model(rig).with_outputs(channel), ONE_AXIS.excitation(1.0)
    silent = model.with_values(truth).simulate(i_e)
    noise = 0.01 * silent.further[channel]
    noisy = model.with_values(truth).virtual_experiment(i_e, further_noise={channel: float(noise.std())}, seed=1)
    found = identify(rig, replace(noisy, i_c=None))
    assert found.is_adequate
    assert f"{SIGNALS[signal].gain}.own" in found.tolerances
    for name, value in truth.items():
        assert abs(found.parameters[name].value - value) < 3.5 * found.parameters[name].std_error, name


def test_a_further_channel_never_widens_an_interval(record):
    without = identify(MASS.replace(tolerance={}), replace(record, further={}))
    beside = identify(MASS.replace(tolerance={}), record)
    for name, parameter in without.parameters.items():
        assert beside.parameters[name].std_error < 1.05 * parameter.std_error, name
    gains = {"flux_gain.A_zeta", "force_gain.A_zeta", "acceleration_gain.mass", "sensor_gain.other"}
    assert gains | {"instant.b", "instant.f", "instant.a", "instant.y"} <= set(beside.tolerances)


def test_a_late_instrument_is_within_its_tolerance_and_a_saved_model_has_it(record, tmp_path):
    column = record.further["a.mass"]
    lines = np.fft.rfft(column[ONE_AXIS.period :]) * np.exp(
        -2j * np.pi * np.fft.rfftfreq(len(column) - ONE_AXIS.period) * 0.02
    )
    late = replace(
        record,
        **{name: getattr(record, name)[ONE_AXIS.period :] for name in ("y", "i_c", "i_e")},
        further={"a.mass": np.fft.irfft(lines, n=len(column) - ONE_AXIS.period)},
    )
    rig = MASS.replace(tolerance={"instant": 2e-6, "acceleration_gain": 0.01})
    found = identify(rig, late)
    own = found.tolerances["instant.a"]
    assert abs(own.posterior_value + 2e-6) < 3.0 * own.posterior_std < 2e-6
    found.model.save(tmp_path / "own.json")
    again = Model.load(tmp_path / "own.json")
    assert again.names == found.model.names
    assert again.at(late).loop.outputs == found.model.at(late).loop.outputs
    assert {p.name: p.prior for p in again.tolerances} == {p.name: p.prior for p in found.model.tolerances}


def test_what_an_experiment_with_further_channels_would_tell_is_foreseen(record):
    own = replace(record, further={name: record.further[name] for name in ("b.A_zeta", "a.mass")})
    found = identify(MASS, own)
    stated = Instruments.stated(1, 50e-9, 5e-3, {name: NOISE[name] for name in own.further})
    for instruments in (stated, Instruments.of(found.comparison)):
        for currents, i_c in ((instruments, own.i_c), (instruments.without_currents(), None)):
            seen = identify(MASS, replace(own, i_c=i_c))
            expected = prospect(found.model, ONE_AXIS.excitation(1.0), period=ONE_AXIS.period, instruments=currents)
            for name, parameter in seen.parameters.items():
                assert expected.parameters[name].std_error == pytest.approx(parameter.std_error, rel=0.2), name
    assert stated.without_currents().beside({"i_c": 5e-3}).channels == stated.channels == 4


def test_the_noise_of_each_instrument_is_told(record):
    found = compare(Model(MASS).with_values({"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}), record)
    rows = {own.channel: own for own in found.records[0].channels}
    silent = measured(MASS, ONE_AXIS.excitation(1.0), {}, seed=None, further=NOISE, **ONE_AXIS.truth)
    for name, rms in NOISE.items():
        noise = (record.further[name] - silent.further[name]).std()
        assert noise > 0.99 * rms  # that of the displacement sensor goes round the loop and adds to it
        assert rows[name].noise_rms == pytest.approx(noise, rel=0.05)
        assert rows[name].residual_rms == pytest.approx(noise, rel=0.05)
    assert "mT" in str(found)
    assert "m/s^2" in str(found)


def test_a_wrong_gain_is_an_error_of_the_instrument(record):
    loud = replace(record, further=dict(record.further) | {"b.A_zeta": 1.06 * record.further["b.A_zeta"]})
    found = identify(MASS.replace(tolerance={"flux_gain": 0.1}), loud)
    own = found.tolerances["flux_gain.A_zeta"]
    assert abs(own.posterior_value - 0.06) < 3.0 * own.posterior_std < 0.06


@pytest.mark.parametrize(
    ("name", "hidden"),
    [("force_nonlinearity", {"share": 1.0}), ("flux_saturation", {"level": 0.75, "curve": "blend"})],
)
def test_iron_lets_the_flux_level_off_and_the_force_goes_with_its_square(name, hidden, validated):
    iron = {key: value for key, value in hidden.items() if key != "share"}
    law = magnet(185.0, 1.18e6, 4.0, **iron)
    flux = np.sqrt(MU_0 * law[2] / 3e-4) * library().iron(law[5], law[6]) / law[6]
    data = MASS.model_dump(by_alias=True, exclude_none=True)
    data["bearing"][0].update(bias_flux=float(flux))
    rig = Rig(**data)
    given = measured(
        rig, ONE_AXIS.excitation(1.0), {name: hidden}, seed=3, further={"b.A_zeta": 2e-3}, **ONE_AXIS.truth
    )
    start = Model(rig).add(name)
    beside, without = identify(start, given), identify(start, replace(given, further={}))
    truth = {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}
    validated(
        "K_i, K_s, tau_e beside iron that saturates, with a Hall sensor: error in standard errors",
        "truth of the independent simulator in C",
        [(beside.parameters[key].value - value) / beside.parameters[key].std_error for key, value in truth.items()],
        3.5,
    )
    assert beside.misfit == pytest.approx(1.0, abs=0.08)
    assert identify(Model(rig), given).misfit > 10.0
    widths = [[p.std_error for key, p in own.parameters.items() if "." in key] for own in (beside, without)]
    assert (np.array(widths[0]) < 1.05 * np.array(widths[1])).all()


@pytest.mark.slow
def test_four_axes():
    rig = instrumented(
        BENCH,
        5e-4,
        [
            {"signal": "a", "name": "middle", "position": BENCH.middle, "direction": 30.0},
            {"signal": "y", "name": "end", "position": 0.1, "direction": -10.0},
        ],
    )
    noise = {f"b.{axis}": 2e-3 for axis in rig.axes} | {"a.middle": 0.05, "y.end": 1e-7, "f.A_zeta": 1.0}
    given = measured(rig, BENCH.excitation(BENCH.amplitude), {}, seed=2, further=noise, **BENCH.truth, **BENCH.noise)
    found = identify(rig, given)
    assert found.misfit == pytest.approx(1.0, abs=0.05)
    truth = dict(zip((f"K_i.{axis}" for axis in rig.axes), BENCH.K_i, strict=True))
    truth |= dict(zip((f"K_s.{axis}" for axis in rig.axes), BENCH.K_s, strict=True)) | {"tau_e": BENCH.tau_e}
    for name, value in truth.items():
        parameter = found.parameters[name]
        assert abs(parameter.value - value) < 3.5 * parameter.std_error, name


def test_virtual_experiments_have_what_is_asked_for(golden):
    model, i_e = Model(MASS).with_outputs("a.mass"), ONE_AXIS.excitation(1.0)[:2000]
    quiet = {"sensor_noise": 0.0, "current_noise": 0.0, "seed": 1}
    silent = model.virtual_experiment(i_e, further_noise={"b": 0.0}, **quiet)
    noisy = model.virtual_experiment(i_e, further_noise={"b.A_zeta": 1e-3}, **quiet)
    assert silent.channels == noisy.channels == ["y.A_zeta", "i_c.A_zeta", "b.A_zeta", "a.mass"]
    assert (noisy.outputs - silent.outputs).std(axis=0) == pytest.approx([0.0, 0.0, 1e-3, 0.0], rel=0.1)
    assert silent == replace(model.with_outputs(("b", "a")).simulate(i_e), name="virtual experiment")
    with golden.raises(ModelError):
        model.with_outputs("b.B_zeta")
    with golden.raises(ModelError):
        model.virtual_experiment(i_e, further_noise={"u": 1.0}, **quiet)


def test_many_virtual_experiments_scatter_as_their_intervals_say():
    rig = MASS.replace(tolerance={"flux_gain": 0.02, "exact": False})
    i_e = ONE_AXIS.excitation(1.0)[: 2 * ONE_AXIS.period]
    plan = Plan(rig, np.tile(i_e, (2, 1)), further_noise={"b": 2e-3, "a.mass": 0.1}, seed=5)
    assert {"flux_gain.A_zeta", "acceleration_gain.mass"} <= set(plan.drawn)
    found = run_monte_carlo(plan, 12)
    assert [row["status"] for row in found.rows] == ["converged"] * 12
    off = [(row["K_i.A_zeta.value"] - row["K_i.A_zeta.true"]) / row["K_i.A_zeta.std_error"] for row in found.rows]
    assert 0.4 < np.std(off) < 1.8
