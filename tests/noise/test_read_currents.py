"""A controller that reads i_c acts on the noise of it: that goes round the loop, as the noise of the sensors does.

The records are of a levitator with a coil of its own, from physics written here apart from the core.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from ambid import Record, Rig, compare, identify
from ambid.loop.response import frequency_response
from ambid.model import Model
from ambid.noise.colour import back_through_loop, loop_noise

RATE, PERIOD, PERIODS = 2000.0, 1600, 5
MASS, TAU = 0.35, 0.012
TRUTH = {"K_i.A_zeta": 4.905, "K_s.A_zeta": 1144.5, "R.A_zeta": 3.2}
NOISE = np.array([1e-6, 1.5e-3])
LAW = {
    "kind": "state_space",
    "implementation": "digital",
    "A": [[1.0, 0.0], [0.0, 0.6]],
    "B": [[1.0, 0.0], [1.0, 0.0]],
    "C": [[7.07, -37794.0]],
    "D": [[102389.0, 9.344]],
    "inputs": ["y", "i_c"],
}
PLACE = {"name": "A", "axes": ["zeta"], "position": 0.0, "sensor_position": 0.0}
GAP = {"bias_current": 1.4, "air_gap": 0.006, "force_current": 4.5, "force_displacement": 1250.0}


def rig(**law) -> Rig:
    return Rig(
        name="levitator",
        sample_rate=RATE,
        rotor={"kind": "mass", "mass": MASS},
        bearing=[PLACE | GAP],
        amplifier={"time_constant": TAU, "resistance": 3.2},
        actuator={"has_lag": False},
        controller=LAW | law,
        tolerance={"exact": True},
    )


def closed(is_read: bool) -> tuple[np.ndarray, ...]:
    """The loop from r and the noise of y and i_c to what is recorded."""
    k_i, k_s, resistance = TRUTH.values()
    rates = np.zeros((4, 4))
    rates[0, 1] = 1.0
    rates[1, [0, 2]] = np.array([k_s, k_i]) / MASS
    rates[2, 2:] = np.array([-1.0, 1.0 / resistance]) / TAU
    step = expm(rates / RATE)
    a, b, c = step[:3, :3], step[:3, 3:], np.eye(3)[[0, 2]]
    a_k, b_k, c_k, d_k = (np.array(LAW[name]) for name in "ABCD")
    read = np.array([[-1.0, 1.0, 0.0], [0.0, 0.0, float(is_read)]])
    return (
        np.block([[a - b @ d_k @ c, -b @ c_k], [b_k @ c, a_k]]),
        np.vstack([-b @ d_k @ read, b_k @ read]),
        np.hstack([c, np.zeros((2, 2))]),
        np.eye(3)[1:],
    )


def records(is_read: bool, count: int, period: int | None):
    chips = np.random.default_rng(1).permutation(PERIOD // 20) % 2 - 0.5
    r = np.tile(np.repeat(2e-4 * chips, 20), PERIODS)
    machine, x, z = rig(reference=True), np.zeros((5, count)), np.zeros((len(r), 2, count))
    u = np.tile(r[:, None, None], (1, 3, count))
    u[:, 1:] = NOISE[:, None] * np.random.default_rng(2).standard_normal((len(r), 2, count))
    a, b, c, d = closed(is_read)
    for k, own in enumerate(u):
        z[k] = c @ x + d @ own
        x = a @ x + b @ own
    for y, i_c in z.transpose(2, 1, 0):
        signals = {"y": y[:, None], "i_c": i_c[:, None], "i_e": np.zeros((len(r), 1)), "r": r[:, None]}
        yield Record.from_arrays(**signals, sample_rate=RATE, axes=machine.axes, rig=machine, period=period)


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_noise_of_what_is_read_goes_round_the_loop(delay):
    """What enters is read times -K, where i_e enters."""
    model = Model(rig(delay_samples=delay))
    points = np.exp(2j * np.pi * np.array([1e-4, 1e-3, 0.01, 0.1, 0.4]))
    law = frequency_response(model.rig.controller.state_space(1, RATE), points)
    expected = np.eye(2) - model.loop.transfer(model.theta, points) @ law
    assert_allclose(loop_noise(model, points, 2), expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())
    assert_allclose(back_through_loop(model, points, 2) @ expected, np.tile(np.eye(2), (5, 1, 1)), atol=1e-6)


def test_an_analog_controller_reads_noise_as_well():
    law = {"A": [[-1e-3, 0.0], [0.0, -1000.0]], "B": [[1.0, 0.0], [1000.0, 0.0]]}
    model = Model(rig(implementation="analog", C=[[2e4, -1e5]], D=[[1.5e5, 9.0]], **law))
    loop, frequency = model.with_noise_inputs(), np.array([0.1, 1.0, 10.0, 300.0])
    assert loop.inputs == ("i_e.A_zeta", "n_i.A_zeta", "n.A_zeta")
    found = loop.frequency_response(model.theta, frequency)
    own = frequency_response(model.rig.controller.state_space(1, RATE), 2j * np.pi * frequency)
    expected = np.eye(2) - found[:, :, :1] @ own
    assert_allclose(found[:, :, [2, 1]], expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("is_read", "period"),
    [
        pytest.param(True, PERIOD, id="read", marks=pytest.mark.slow),
        pytest.param(False, PERIOD, id="not read", marks=pytest.mark.slow),
        pytest.param(True, None, id="without periods", marks=pytest.mark.slow),
    ],
)
def test_intervals_hold_the_truth(is_read, period):
    """Of 60 (estimate - truth)/error scatters by 1 within 0.09; that of K_s in noise of unknown colour by 1.5."""
    off, misfits = [], []
    for record in records(is_read, 60, period):
        found = identify(rig(reference=True), record)
        shown = found.to_json()["parameters"]
        off.append([(shown[name]["value"] - true) / shown[name]["std_error"] for name, true in TRUTH.items()])
        misfits.append(found.misfit)
    off = np.array(off)
    assert (off.std(axis=0) > 0.75).all()
    assert (off.std(axis=0) < 1.27).all()
    assert (np.abs(off.mean(axis=0)) < 0.4).all()
    assert (np.abs(off) < 1.96).mean() > 0.9
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("is_read", [True, False])
def test_who_records_the_currents_is_told_by_the_record(is_read):
    """As far as the loop shapes their noise; above its bandwidth it may be either."""
    model = Model(rig(reference=True))
    for record in records(is_read, 5, PERIOD):
        (found,) = compare(model, record).records[0].findings
        assert found.code == "noise_arises"
        assert (found.values["heard_a"] > 3.0 * found.values["recorder_a"]) == is_read
        assert (found.values["recorder_a"] > 2.0 * found.values["heard_a"]) != is_read
        assert found.values["heard_m"] > 3.0 * found.values["recorder_m"]


def test_a_virtual_experiment_reads_its_noise():
    """Noise of i_c, which 5 mA of it shows best in y."""
    model, still = Model(rig()), np.zeros((4000, 1))
    record = model.virtual_experiment(still, sensor_noise=0.0, current_noise=5e-3, seed=1)
    assert record.y.std() > 1e-6
    as_if_white = 5e-3 * np.random.default_rng(1).standard_normal((2, 4000, 1))[1]
    assert np.corrcoef(record.i_c.T, as_if_white.T)[0, 1] > 0.5


@pytest.mark.parametrize("reads", [True, False])
def test_y_alone_of_a_controller_that_reads_i_c_is_told(reads):
    """Noise of y is then of two colours, which one inverse filter cannot separate."""
    own = rig(**({} if reads else {"inputs": ["y"], "B": [[1.0], [1.0]], "D": [[102389.0]]}))
    y, i_e = 1e-5 * np.random.default_rng(1).standard_normal((2, 4000, 1))
    record = Record.from_arrays(y=y, i_e=1e3 * i_e, sample_rate=RATE, axes=own.axes, rig=own)
    assert ("read_current_not_recorded" in {own.code for own in record.findings}) == reads
