"""Sensitivities of the loop against complex steps, and where poles coincide."""

import numpy as np
import pytest

from ambid.rig import Rig
from reference.loop_rigs import (
    CROSSED,
    DIGITAL,
    RIGS,
    assert_close,
    excitation,
    loop_of,
    parameters,
    physical,
    rig,
)


def assert_slopes_by_complex_step(machine: Rig, shared: bool, theta: np.ndarray, samples: int = 60) -> None:
    u, every = excitation(machine, samples), range(len(theta))
    y, jacobian = loop_of(machine, shared).sensitivity(theta, u, every)
    step = 1e-20 * theta
    stepped = physical(machine, theta[:, None] + 1j * np.diag(step), shared).respond(u)
    expected = stepped.imag / step
    assert_close(y, stepped[:, :, 0].real, 1e-9)
    peak = np.max(np.abs(expected), axis=0)
    n = len(machine.axes)  # each column by the peak of its own unit: a parameter of one plane does nothing in the other
    for slopes, exact in ((jacobian[:, :n], expected[:, :n]), (jacobian[:, n:], expected[:, n:])):
        peak = np.max(np.abs(exact), axis=(0, 1))
        assert np.all(peak > 0.0)
        assert np.max(np.abs(slopes - exact) / peak) < 1e-8


@pytest.mark.parametrize("shared", [True, False], ids=["one tau_e", "tau_e of each axis"])
@pytest.mark.parametrize("name", ["analog", "analog, rotating", "digital, delay 1.5, twice the rate"])
def test_sensitivity_agrees_with_complex_step(name, shared):
    assert_slopes_by_complex_step(RIGS[name], shared, parameters(RIGS[name], shared))


@pytest.mark.parametrize(
    "name",
    ["analog, ideal amplifier", "analog, one axis", "digital, delay 0.3, ideal amplifier"],
)
def test_sensitivity_agrees_with_complex_step_on_odd_rigs(name):
    assert_slopes_by_complex_step(RIGS[name], False, parameters(RIGS[name]))


@pytest.mark.parametrize("spread", [0.0, 1e-6, 2e-5, 1e-3])
@pytest.mark.parametrize("controller", [{}, DIGITAL], ids=["analog", "digital"])
def test_sensitivity_holds_where_the_poles_of_two_planes_coincide(controller, spread):
    """Crossed axes couple two equal planes, so that their poles are double or nearly so."""
    machine = rig(tilts=(30.0, 75.0), **controller)
    assert_slopes_by_complex_step(machine, True, parameters(machine, True, spread))


@pytest.mark.parametrize("delay", [0.3, 1.0, 1.5, 2.2])
@pytest.mark.parametrize("steps", [2, 4])
def test_sensitivity_holds_where_the_poles_of_the_delay_gather_at_zero(steps, delay):
    """Commands under way are forgotten within a sample of the record, the more so with a faster controller."""
    machine = rig(amplifier=5e-5, **CROSSED, **DIGITAL | {"delay_samples": delay, "sample_rate": steps * 1e4})
    assert_slopes_by_complex_step(machine, False, parameters(machine), samples=30)


def test_sensitivity_gives_the_asked_columns_in_their_order():
    machine = RIGS["analog"]
    loop, theta, u = loop_of(machine), parameters(machine), excitation(machine)
    _, whole = loop.sensitivity(theta, u, range(12))
    y, some = loop.sensitivity(theta, u, [7, 0, 10])
    assert_close(y, loop.simulate(theta, u), 1e-10)
    # the columns of the other plane are zero
    assert np.max(np.abs(some - whole[:, :, [7, 0, 10]])) <= 1e-10 * np.max(np.abs(some))
