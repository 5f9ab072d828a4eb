"""Controllers that act on y - r and read the current, against a levitator that was written from its physics."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid import Model, Rig, RigError
from ambid.effects.magnet import ForceNonlinearity
from ambid.loop.response import frequency_response
from ambid.rig import Amplifier, StateSpaceController, TransferFunctionController
from reference.levitator import Levitator, pid, pid_matrices

RATE = 1000.0
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
GAINS = (300.0, 900.0, 12.0)


def rig(**controller) -> Rig:
    own = {"kind": "state_space", "implementation": "digital", "reference": True, "inputs": ["y", "i_c"]}
    return TRUTH.rig(RATE, own | pid_matrices(*GAINS, RATE, 0.4) | controller)


def drives(samples: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    r = np.repeat(1e-4 * random.standard_normal(samples // 50), 50)
    return r, 0.01 * random.standard_normal(samples)


def test_digital_loop_that_follows_a_reference_and_reads_its_current_is_exact():
    r, i_e = drives()
    truth = TRUTH.run(RATE, pid(*GAINS, RATE, 0.4), r, i_e)
    model = Model(rig())
    assert model.loop.inputs == ("i_e.A_zeta", "r.A_zeta")
    found = model.loop.simulate(model.theta, np.column_stack([i_e, r]))
    expected = np.hstack([truth["y"], truth["i_c"]])
    assert np.abs(found - expected).max() < 1e-11 * np.abs(expected).max()
    stepped = model.simulator().run(np.column_stack([i_e, r]))
    assert_allclose(stepped, found, rtol=0, atol=1e-12 * np.abs(found).max())


def test_what_is_watched_leaves_the_loop_as_it_is():
    model = Model(rig())
    watched = model.watching(("s", "i_ref", "y", "i_c"))
    assert_allclose(watched.poles(model.theta), model.poles(), rtol=1e-9)


def test_a_column_of_its_own_for_the_reference_is_the_same_loop():
    model = Model(rig())
    own = pid_matrices(*GAINS, RATE, 0.4)
    own["B"] = [[*row, -row[0]] for row in own["B"]]
    own["D"] = [[*row, -row[0]] for row in own["D"]]
    apart = Model(rig(reference=False, inputs=["y", "i_c", "r"], **own))
    r, i_e = drives(300)
    u = np.column_stack([i_e, r])
    expected = model.loop.simulate(model.theta, u)
    assert_allclose(apart.loop.simulate(model.theta, u), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_slopes_by_time_and_on_lines_agree_with_differences():
    r, i_e = drives(400)
    model, u = Model(rig(delay_samples=1.5)), np.column_stack([i_e, r])
    _, slopes = model.loop.sensitivity(model.theta, u, [0, 1])
    w = np.exp(2j * np.pi * np.arange(1, 60) / 400)
    inputs = np.fft.rfft(u, axis=0)[1:60]
    _, on_lines, _ = model.loop.core.lines(model.theta, [0, 1], w, np.ascontiguousarray(inputs), None, False)
    for j in range(2):
        step = 1e-5 * model.theta[j] * np.eye(2)[j]
        sides = [model.loop.simulate(model.theta + sign * step, u) for sign in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step[j])
        assert np.abs(slopes[..., j] - expected).max() < 1e-7 * np.abs(expected).max()
        sides = [model.loop.core.lines(model.theta + s * step, [], w, inputs, None, False)[0] for s in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step[j])
        assert np.abs(on_lines[..., j] - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize("single", [False, True])
def test_nonlinear_loop_follows_the_reference_too(single):
    r, i_e = drives(300)
    K_i, bias, gap = TRUTH.K_i, 0.9, 0.005
    magnets = Levitator(TRUTH.mass, K_i, K_i * bias / gap, TRUTH.tau, gap=gap, bias=bias, single=single)
    truth = magnets.run(RATE, pid(*GAINS, RATE, 0.4), r, i_e)
    model = Model(rig()).with_values({"K_s.A_zeta": magnets.K_s})
    expected = np.hstack([truth["y"], truth["i_c"]])
    u = np.column_stack([i_e, r])
    linear = model.loop.simulate(model.theta, u)
    model = model.add(ForceNonlinearity(single=single), {"bias_ratio": 1.0})
    found = model.loop.simulate(model.theta, u)
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max() < np.abs(linear - expected).max()
    assert_allclose(model.simulator().run(u), found, rtol=0, atol=1e-6 * np.abs(found).max())


def test_analog_loop_follows_the_reference_as_its_transfer_functions_say():
    own = TRUTH.rig(
        RATE,
        {
            "kind": "transfer_function",
            "implementation": "analog",
            "reference": True,
            "inputs": ["y", "i_c"],
            "numerator": [[12.0 * 2000.0, 400.0 * 2000.0], [0.4]],
            "denominator": [[1.0, 2000.0], [1.0]],
        },
    )
    model = Model(own)
    f = np.array([0.5, 3.0, 20.0, 90.0])
    s = 2j * np.pi * f
    K = (12.0 * 2000.0 * s + 400.0 * 2000.0) / (s + 2000.0)
    P = TRUTH.K_i / (TRUTH.mass * s**2 - TRUTH.K_s)  # y over i
    lag = 1.0 / (1.0 + TRUTH.tau * s)
    current = lag / (1.0 + lag * 0.4 + lag * K * P)  # i over what is added to the command
    found = model.loop.frequency_response(model.theta, f)
    assert_allclose(found[:, 1, 0], current, rtol=1e-9)
    assert_allclose(found[:, 1, 1], K * current, rtol=1e-9)
    assert_allclose(found[:, 0, 1], P * K * current, rtol=1e-9)


def test_a_pid_may_follow_a_reference():
    keys = {"kind": "pid", "implementation": "analog", "proportional": 300.0, "derivative": 12.0}
    own = TRUTH.rig(RATE, keys | {"derivative_time_constant": 1e-3, "reference": True})
    model = Model(own)
    K = 300.0 + 12.0 * 2j * np.pi * 5 / (1 + 1e-3 * 2j * np.pi * 5)
    found = model.loop.frequency_response(model.theta, np.array([5.0]))[0]
    assert_allclose(found[:, 1], K * found[:, 0], rtol=1e-9)


def test_two_axes_are_read_signal_by_signal():
    keys = {"kind": "state_space", "implementation": "analog", "inputs": ["y", "i_c"]}
    controller = keys | {"A": [[-3.0]], "B": [[1.0, 2.0]], "C": [[5.0]], "D": [[7.0, 8.0]]}
    a, b, c, d = StateSpaceController(**controller).state_space(2, 1e3)
    assert_allclose(d, [[7.0, 0.0, 8.0, 0.0], [0.0, 7.0, 0.0, 8.0]])
    assert_allclose(b, [[1.0, 0.0, 2.0, 0.0], [0.0, 1.0, 0.0, 2.0]])
    whole = frequency_response((a, b, c, d), np.array([1j]))
    assert_allclose(whole[0, 0, ::2], [7 + 5 / (1j + 3), 8 + 10 / (1j + 3)])


def test_polynomials_are_given_per_signal():
    keys = {"implementation": "digital", "inputs": ["y", "i_c"]}
    own = TransferFunctionController(**keys, numerator=[[2.0, 1.0], [3.0]], denominator=[1.0, -0.5])
    z = np.array([np.exp(0.3j)])
    found = frequency_response(own.state_space(2, 1e3), z)[0]
    one, two = (2 * z[0] + 1) / (z[0] - 0.5), 3 / (z[0] - 0.5)
    assert_allclose(found, [[one, 0, two, 0], [0, one, 0, two]], atol=1e-12)


UNREADABLE = {
    "twice": {"inputs": ["y", "y"]},
    "without y": {"inputs": ["i_c"], "B": [[0.0], [0.0]], "D": [[1.0]]},
    "unknown": {"inputs": ["y", "v"]},
    "a column too many": {"inputs": ["y"]},
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_cannot_be_read_is_refused(name, golden):
    with golden.raises(RigError):
        rig(**UNREADABLE[name])


def test_a_current_that_follows_at_once_cannot_be_read(golden):
    with golden.raises(RigError):
        rig().replace(amplifier=Amplifier(time_constant=0.0))
