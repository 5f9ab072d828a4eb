"""Controllers: their state space against closed forms, and what is taken over from other packages."""

import control
import numpy as np
import pytest
import scipy.signal

from ambid.errors import RigError
from ambid.rig import Controller, PidController, StateSpaceController, TransferFunctionController

FREQUENCIES_HZ = np.array([0.3, 7.0, 60.0, 551.0, 2300.0])


def response(system, points):
    """C (p I - A)^-1 B + D at each point p: shape (points, outputs, inputs)."""
    a, b, c, d = system
    return np.array([c @ np.linalg.solve(p * np.eye(len(a)) - a, b) + d for p in points])


def on_every_axis(values, n_axes):
    return np.array(values)[:, None, None] * np.eye(n_axes)


def pid_closed_form(s):
    return 28000.0 + 2e5 / s + 60.0 * s / (1e-4 * s + 1.0)


@pytest.mark.parametrize("rate", [None, 20000.0])
@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_pid_against_its_closed_form(implementation, rate):
    gains = {"proportional": 28000.0, "integral": 2e5, "derivative": 60.0, "derivative_time_constant": 1e-4}
    digital = implementation == "digital"
    controller = PidController(implementation=implementation, sample_rate=rate if digital else None, **gains)
    system = controller.state_space(4, 10000.0)
    s = 2j * np.pi * FREQUENCIES_HZ
    if digital:
        h = 1.0 / (rate or 10000.0)
        z = np.exp(s * h)
        expected, points = pid_closed_form(2.0 / h * (z - 1.0) / (z + 1.0)), z
    else:
        expected, points = pid_closed_form(s), s
    assert system[0].shape == (8, 8)
    np.testing.assert_allclose(response(system, points), on_every_axis(expected, 4), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(
    ("gains", "n_states"),
    [
        ({}, 0),
        ({"integral": 5.0}, 4),
        ({"derivative": 5.0, "derivative_time_constant": 1e-3}, 4),
        ({"integral": (5.0, 0.0, 0.0, 5.0), "derivative": 0.0}, 2),
    ],
)
@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_pid_has_no_state_for_a_gain_of_zero(implementation, gains, n_states):
    controller = PidController(implementation=implementation, proportional=(1.0, 2.0, 3.0, 4.0), **gains)
    a, b, c, d = controller.state_space(4, 1000.0)
    assert (a.shape, b.shape, c.shape, d.shape) == ((n_states,) * 2, (n_states, 4), (4, n_states), (4, 4))
    if not n_states:
        np.testing.assert_array_equal(d, np.diag([1.0, 2.0, 3.0, 4.0]))


def test_transfer_functions_against_polynomials():
    numerator, denominator = [0.0, 60.0, 2.8e4, 2e5], [1e-4, 1.0, 0.0]
    with pytest.raises(RigError, match="improper"):
        TransferFunctionController(implementation="analog", numerator=[1.0, *numerator], denominator=denominator)
    numerator = [[60.0, 2.8e4, 2e5], [0.0, 0.0, 7.0]]
    controller = TransferFunctionController(implementation="analog", numerator=numerator, denominator=denominator)
    s = 2j * np.pi * FREQUENCIES_HZ
    expected = np.zeros((len(s), 2, 2), dtype=complex)
    for k in range(2):
        expected[:, k, k] = np.polyval(numerator[k], s) / np.polyval(denominator, s)
    np.testing.assert_allclose(response(controller.state_space(2, 1e4), s), expected, rtol=1e-9)


def test_state_space_is_taken_as_given_or_repeated():
    rng = np.random.default_rng(1)
    a, b, c, d = (rng.normal(size=shape) for shape in ((3, 3), (3, 2), (2, 3), (2, 2)))
    controller = StateSpaceController(implementation="digital", A=a, B=b, C=c, D=d, delay_samples=0.5)
    for found, given in zip(controller.state_space(2, 1e4), (a, b, c, d), strict=True):
        np.testing.assert_array_equal(found, given)
    single = StateSpaceController(implementation="analog", A=[[-1.0]], B=[[2.0]], C=[[3.0]], D=[[4.0]])
    np.testing.assert_array_equal(single.state_space(4, 1e4)[0], -np.eye(4))


LTI = {
    "control-tf": control.tf([60.0, 2.8e4], [1e-4, 1.0]),
    "control-tf-digital": control.tf([2.0, 1.0], [1.0, -0.5], 1e-4),
    "control-ss": control.ss([[-5.0]], [[1.0]], [[2.0]], [[3.0]]),
    "control-ss-digital": control.ss([[0.5]], [[1.0]], [[2.0]], [[3.0]], 5e-5),
    "scipy-tf": scipy.signal.TransferFunction([60.0, 2.8e4], [1e-4, 1.0]),
    "scipy-tf-digital": scipy.signal.TransferFunction([2.0, 1.0], [1.0, -0.5], dt=1e-4),
    "scipy-ss": scipy.signal.StateSpace([[-5.0]], [[1.0]], [[2.0]], [[3.0]]),
    "scipy-ss-digital": scipy.signal.StateSpace([[0.5]], [[1.0]], [[2.0]], [[3.0]], dt=5e-5),
    "scipy-zpk": scipy.signal.ZerosPolesGain([-10.0], [-1000.0], 2.0),
}


@pytest.mark.parametrize("system", LTI.values(), ids=LTI)
def test_from_lti(system):
    controller = Controller.from_lti(system)
    assert controller.is_digital == bool(system.dt)
    if system.dt:
        assert controller.rate(1e4) == pytest.approx(1.0 / system.dt)
    s = 2j * np.pi * FREQUENCIES_HZ
    points = np.exp(s * system.dt) if system.dt else s
    if isinstance(system, control.lti.LTI):
        expected = system(points)
    else:
        expected = system.freqresp(2.0 * np.pi * FREQUENCIES_HZ * (system.dt or 1.0))[1]
    found = response(controller.state_space(4, 1e4), points)
    np.testing.assert_allclose(found, on_every_axis(expected, 4), rtol=1e-9)


def test_from_lti_takes_one_transfer_function_per_axis():
    system = control.tf([[[1.0], [0.0]], [[0.0], [2.0]]], [[[1.0, 1.0], [1.0]], [[1.0], [1.0, 3.0]]])
    controller = Controller.from_lti(system)
    assert controller.numerator == ((1.0,), (2.0,))
    assert controller.denominator == ((1.0, 1.0), (1.0, 3.0))


REFUSED = {
    "number": 3.0,
    "no-dt": control.tf([1.0], [1.0, 0.5], True),
    "coupled": control.tf([[[1.0], [1.0]], [[0.0], [1.0]]], [[[1.0, 1.0]] * 2] * 2),
    "tall": scipy.signal.TransferFunction([[1.0, 2.0], [1.0, 3.0]], [1.0, 1.0]),
    "improper": control.tf([1.0, 0.0, 0.0], [1.0, 1.0]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_from_lti_refuses(name, golden):
    with golden.raises(RigError):
        Controller.from_lti(REFUSED[name])


def test_from_lti_with_delay_needs_a_digital_system(golden):
    assert Controller.from_lti(LTI["scipy-tf-digital"], delay_samples=1.5).delay_samples == 1.5
    with golden.raises(RigError):
        Controller.from_lti(LTI["scipy-tf"], delay_samples=1.5)


def test_sizes_beyond_reason_are_refused_with_the_number_and_the_cap(golden):
    with golden.raises(RigError):
        StateSpaceController(
            implementation="analog", A=np.eye(201), B=np.ones((201, 1)), C=np.ones((1, 201)), D=[[0.0]]
        )
    with golden.raises(RigError):
        TransferFunctionController(implementation="analog", numerator=[1.0], denominator=[1.0] * 62)
