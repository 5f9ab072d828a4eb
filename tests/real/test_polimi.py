"""A levitator that can be bought, driven by its reference alone; tests/data/mls2em ships one run, with its licence."""

import numpy as np
import pytest

from ambid import Model, Record, Rig, check, diagnose, identify
from ambid.effects import find
from found import codes, the
from places import TESTS

RUN = TESTS / "data/mls2em"
VOLTS = 11.658  # of the driver, per unit of control
NOISE = 16e-6  # m, of heights as read in other runs


@pytest.fixture(scope="module")
def run():
    rig = Rig.load(RUN / "rig.toml")
    return rig, Record.load(RUN / "step.csv", rig)


def test_the_law_of_its_controller_is_told(run, golden, validated):
    rig, record = run
    (law,) = check(rig, [record]).laws["step"]
    golden.holds(law.text)
    assert law.left < 1e-7
    assert law.rig_left < 1e-5
    published = {"e": 100.0, "int e": 120.0, "de/dt": 13.0}
    validated(
        "Gains of the controller of a levitator MLS2EM, from its record: relative error",
        "gains in the published results of its laboratory (INTECO MLS2EM, Politecnico di Milano)",
        [law.gains[name] / VOLTS / expected - 1.0 for name, expected in published.items()],
        1e-3,
    )


def test_the_clipped_kick_of_the_derivative_is_a_known_excitation(run):
    _, record = run
    moved = np.flatnonzero(np.abs(np.diff(record.i_e[:, 0])) > 1e-3)
    assert np.isin([1999, 2000], moved).all()
    assert len(moved) < 5


def test_its_height_is_that_of_a_filter(run):
    """As read it has a quantum of 1.4 um, so that values come again, and a noise of ten times that."""
    height = run[1].y[:, 0]
    assert len(np.unique(height)) > 0.9 * len(height)
    assert np.std(np.diff(height[:1500], 3)) / np.sqrt(20.0) < 0.1 * NOISE


@pytest.fixture(scope="module")
def found(run):
    return diagnose(*run)


@pytest.mark.slow
def test_a_step_that_the_model_misses_is_not_adequate(found):
    """Behind that filter K_i is 0.7 of what the holding current says; over the whole record the misfit is of noise."""
    assert found.verdict == "none_of_the_candidates"
    units = {port.name: port.unit for port in found.localisation.ports}
    assert units == {"force": "N", "current": "V", "sensor": "m", "reading": "A"}, "what is commanded is a voltage"
    assert found.history[0].misfit < found.fit.bound
    assert "residual_higher_in_motion" in codes(found)


@pytest.mark.slow
def test_resistance_and_inductance_are_those_measured_at_rest(run, found, validated):
    rig, record = run
    validated(
        "Resistance of the coil of a levitator MLS2EM: relative error",
        "4.17 Ohm, measured at rest",
        found.parameters["R.A_zeta"].value / 4.17 - 1.0,
        0.02,
    )
    with_coil = identify(Model(rig).add("amplifier_bandwidth"), record)
    validated(
        "Inductance of the coil of a levitator MLS2EM: relative error",
        "0.117 H, measured at rest",
        with_coil.parameters["amplifier_bandwidth.inductance"].value / 0.117 - 1.0,
        0.05,
    )


@pytest.mark.slow
def test_the_inductance_is_the_same_where_a_diagnosis_is_asked_for_it(run):
    chosen = diagnose(*run, effects=["amplifier_bandwidth"])
    assert chosen.parameters["amplifier_bandwidth.inductance"].value == pytest.approx(0.117, rel=0.05)


@pytest.mark.slow
def test_from_the_ideal_coil_on_its_inductance_is_found(run):
    """From a lag of a sample the score sees nothing of one of 28 samples; refits start further off.

    Then the mains comes up, some hundredths of a newton.
    """
    rig, record = run
    ideal = rig.replace(amplifier=rig.amplifier.model_copy(update={"time_constant": 0.002}))
    alike = ("amplifier_bandwidth", "periodic_disturbance", "loop_delay", "back_emf", "foundation_resonance")
    found = diagnose(ideal, record, catalogue=[find(name) for name in alike])
    assert found.effects[:2] == ("amplifier_bandwidth", "periodic_disturbance")
    assert found.model.effects[1].frequency_hz == pytest.approx(50.0, abs=0.1)
    assert found.parameters["amplifier_bandwidth.inductance"].value == pytest.approx(0.117, rel=0.05)
    assert the(found, "mostly_explained").values["when"] == "in motion"
