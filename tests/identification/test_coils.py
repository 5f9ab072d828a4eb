"""Coils whose voltage is recorded: R, L and back-EMF, and which of both is commanded, by the independent simulator."""

from dataclasses import replace

import numpy as np
import pytest

from ambid.diagnosis import diagnose
from ambid.identification import identify
from ambid.model import Model
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS

RESISTANCE, LAG = 2.0, 1e-4
K_I = ONE_AXIS.K_i[0]
"""Of a magnet without losses also the voltage that motion induces [V s/m]."""
LOUDER = {own: RESISTANCE * getattr(ONE_AXIS.rig.controller, own) for own in ("proportional", "integral", "derivative")}
VOLTAGE = ONE_AXIS.rig.replace(
    amplifier={"time_constant": LAG, "resistance": RESISTANCE},
    controller=ONE_AXIS.rig.controller.model_copy(update=LOUDER),
)
"""Voltage is commanded."""
CURRENT = ONE_AXIS.rig.replace(
    amplifier={"time_constant": LAG, "coil_resistance": RESISTANCE, "coil_inductance": RESISTANCE * LAG}
)
"""The same coil, of which current is commanded."""
EMF = {"back_emf": {"coefficient": K_I / RESISTANCE}}


def recorded(rig, hidden, times, seed):
    i_e = times * ONE_AXIS.excitation(1.0)
    return measured(rig, i_e, hidden, seed=seed, further={"u.A_zeta": 0.05}, **ONE_AXIS.truth)


@pytest.fixture(scope="module")
def of_voltage():
    return recorded(VOLTAGE, EMF, RESISTANCE, 5)


@pytest.fixture(scope="module")
def of_current():
    return recorded(CURRENT, {}, 1.0, 6)


def test_resistance_inductance_and_back_emf_of_a_coil_whose_voltage_is_commanded(of_voltage, validated):
    rig = VOLTAGE.replace(
        amplifier={"time_constant": 1.15 * LAG, "resistance": 1.8},
        tolerance=dict.fromkeys(("mass", "sensor_gain", "current_gain", "excitation_gain", "instant"), 0.0)
        | {"controller_gain": 0.0, "voltage_gain": 0.0, "amplifier_time_constant": 0.2},
    )
    found = identify(Model(rig).add("back_emf"), of_voltage)
    assert found.is_adequate
    truth = {"K_i.A_zeta": K_I, "K_s.A_zeta": ONE_AXIS.K_s[0], "R.A_zeta": RESISTANCE, "tau_e": ONE_AXIS.tau_e}
    truth["back_emf.voltage_per_velocity"] = K_I
    off = [(found.parameters[name].value - value) / found.parameters[name].std_error for name, value in truth.items()]
    lag = found.tolerances["amplifier_time_constant.A_zeta"]
    validated(
        "K_i, K_s, tau_e, R, L/R and back-EMF of a coil, from y, its voltage and current: error in standard errors",
        "truth of the independent simulator in C",
        [*off, (lag.posterior_value + 1.0 - 1.0 / 1.15) / lag.posterior_std],
        3.5,
    )
    assert lag.posterior_std < 1e-3
    by_voltage = identify(Model(rig).add("back_emf"), replace(of_voltage, i_c=None))
    assert {name for direction in by_voltage.directions for name in direction} == {"K_i.A_zeta", "R.A_zeta"}


def test_a_gain_of_the_probe_is_one_of_all_that_it_reads(of_voltage):
    """Of the voltage that motion induces, too."""
    found = identify(Model(VOLTAGE.replace(tolerance={})).add("back_emf", {"voltage_per_velocity": K_I}), of_voltage)
    models = (found.model.with_values({"voltage_gain.A_zeta": gain}) for gain in (0.0, 0.03))
    true, read = (model.response(of_voltage)[:, of_voltage.channels.index("u.A_zeta")] for model in models)
    np.testing.assert_allclose(read, 1.03 * true, rtol=1e-9, atol=1e-9 * np.abs(true).max())


def as_current(record):
    """As somebody holds the record who takes the command for amperes, at one ampere for R volts."""
    return replace(record, i_e=record.i_e / RESISTANCE)


@pytest.mark.slow
def test_a_coil_whose_voltage_is_commanded_is_told_from_an_amplifier_of_current_by_its_back_emf(of_voltage):
    assert identify(CURRENT.replace(tolerance={}), as_current(of_voltage)).misfit > 1e3
    found = diagnose(CURRENT.replace(tolerance={}), as_current(of_voltage))
    assert (found.verdict, found.effects) == ("explained", ("back_emf",))
    induced = found.parameters["back_emf.current_per_velocity"]
    assert abs(induced.value - K_I / RESISTANCE) < 3.5 * induced.std_error < 0.1 * induced.value


def test_an_amplifier_of_current_is_told_from_a_coil_whose_voltage_is_commanded(of_current):
    """By its voltage, which is no command; without one by the back-EMF, which it does not let through."""
    taken = replace(of_current, i_e=RESISTANCE * of_current.i_e)
    found = diagnose(VOLTAGE.replace(tolerance={}), taken)
    assert found.verdict == "none_of_the_candidates"
    assert "missing_port" in {finding.code for finding in found.findings}
    without = identify(Model(VOLTAGE.replace(tolerance={})).add("back_emf"), replace(taken, further={}))
    induced = without.parameters["back_emf.voltage_per_velocity"]
    assert without.is_adequate
    assert abs(induced.value) < 3.5 * induced.std_error < 0.01 * K_I
