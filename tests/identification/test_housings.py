"""Sensors on housings, by the independent simulator: what they read, and what they tell beside currents."""

import numpy as np
import pytest

from ambid.diagnosis import diagnose
from ambid.errors import RigError
from ambid.identification import identify
from ambid.model import Model
from ambid.record import Record
from hidden.bench import measured, simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from validated import of_peak

MOVES = {"foundation_resonance": {"frequency_hz": 170.0, "damping": 0.04, "mass_kg": 100.0}}
MODE = {"frequency_hz": 170.0, "damping": 0.04, "inverse_mass": 0.01}
RIG = ONE_AXIS.rig.replace(sensors=[{"signal": "a", "name": "pedestal", "housing": "A"}])
BENCH = BENCHES["bench"]


def without_y(record, i_c=True) -> Record:
    """What a machine with an accelerometer, and a probe of its currents, gives."""
    own = {name: getattr(record, name) for name in ("i_e", "further", "axes", "sample_rate")}
    return Record.from_arrays(**own, i_c=record.i_c if i_c else None, rig=RIG)


def recorded(hidden, seed):
    return measured(RIG, ONE_AXIS.excitation(1.0), hidden, seed=seed, further={"a.pedestal": 0.01}, **ONE_AXIS.truth)


def test_sensors_read_the_motion_of_the_housing_along_their_direction(validated):
    sensors = [
        {"signal": "a", "name": "a_of_A", "housing": "A", "direction": 30.0},
        {"signal": "y", "name": "y_of_B", "housing": "B", "direction": -10.0},
    ]
    rig, i_e = BENCH.rig.replace(sensors=sensors), BENCH.excitation(1.0)[:600]
    names = [sensor.channel for sensor in rig.sensors]
    seen = simulate(rig, i_e, MOVES, seed=None, further=dict.fromkeys(names, 0.0), **BENCH.truth)
    truth = dict(zip((f"K_i.{axis}" for axis in rig.axes), BENCH.K_i, strict=True))
    truth |= dict(zip((f"K_s.{axis}" for axis in rig.axes), BENCH.K_s, strict=True)) | {"tau_e": BENCH.tau_e}
    model = Model(rig).with_values(truth).add("foundation_resonance", MODE).with_outputs(names)
    own = model.simulate(i_e)
    validated(
        "Acceleration and displacement of housings on a foundation: relative error of a record",
        "the independent simulator in C",
        of_peak(*(np.column_stack([one.further[name] for name in names]) for one in (own, seen))),
        1e-6,
    )


def test_accelerations_of_the_housing_beside_currents_give_all_parameters(validated):
    found = identify(Model(RIG).add("foundation_resonance", MODE), without_y(recorded(MOVES, 1)))
    assert found.is_adequate
    truth = {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}
    truth |= {f"foundation_resonance.{name}": value for name, value in MODE.items()}
    validated(
        "K_i, K_s, tau_e and the mode of a housing from its acceleration and the current: error in standard errors",
        "truth of the independent simulator in C",
        [(found.parameters[name].value - value) / found.parameters[name].std_error for name, value in truth.items()],
        3.5,
    )


def test_what_moves_the_housing_is_named():
    found = diagnose(RIG, without_y(recorded(MOVES, 2)))
    assert (found.verdict, found.effects) == ("explained", ("foundation_resonance",))


@pytest.mark.parametrize("hidden", [{}, MOVES], ids=["at rest", "moves"])
def test_without_currents_a_housing_says_nothing_of_the_magnets(hidden):
    found = diagnose(RIG, without_y(recorded(hidden, 3), i_c=False))
    assert found.verdict == "not_informative"
    assert "not_determined" in {finding.code for finding in found.findings}


def test_a_housing_at_rest_leaves_currents_what_they_tell():
    found = identify(RIG, without_y(recorded({}, 4)))
    assert found.is_adequate
    for name, value in {"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4}.items():
        assert abs(found.parameters[name].value - value) < 3.5 * found.parameters[name].std_error, name


def test_a_housing_is_that_of_a_bearing(golden):
    with golden.raises(RigError):
        RIG.replace(sensors=[{"signal": "a", "name": "pedestal", "housing": "C"}])
