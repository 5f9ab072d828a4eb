"""Poles and whirl against closed forms: polynomials of one axis, and of a rigid rotor that turns."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ambid
from ambid.errors import InputError
from ambid.model import Model
from ambid.robustness.eigenvalues import growing
from ambid.robustness.procedure import NOT_LINEAR
from ambid.robustness.whirl import whirl_of
from places import BENCH, LEVITATOR
from validated import relative
from virtual import VirtualBench


@pytest.fixture(scope="module")
def levitator():
    return ambid.Rig.load(LEVITATOR)


def characteristic(pid, lags, mass, K_i, K_s, gyroscopic=0.0):
    """(m s^2 - j g s - K_s) s (T_d s + 1) prod(T s + 1) + K_i (P s (T_d s + 1) + I (T_d s + 1) + D s^2)."""
    filtered = np.array([pid.derivative_time_constant, 1.0])
    own = np.polymul(np.array([mass, -1j * gyroscopic, -K_s]), np.polymul([1.0, 0.0], filtered))
    for lag in lags:
        own = np.polymul(own, [lag, 1.0])
    law = np.polyadd(pid.proportional * np.polymul([1.0, 0.0], filtered), pid.integral * filtered)
    return np.polyadd(own, K_i * np.polyadd(law, [pid.derivative, 0.0, 0.0]))


def of_levitator(model):
    rig, (K_i, K_s, tau_e) = model.rig, model.theta
    return np.roots(characteristic(rig.controller, [rig.amplifier.time_constant, tau_e], 12.0, K_i, K_s))


def upper(poles):
    poles = np.asarray(poles, dtype=complex)
    poles = np.where(np.abs(poles.imag) < 1e-7 * np.abs(poles), poles.real, poles)
    return np.sort_complex(poles[poles.imag >= 0.0])


def test_poles_of_one_axis_are_the_roots_of_its_polynomial(levitator, validated):
    found = ambid.pole_map(Model(levitator))
    validated(
        "Closed-loop poles of one axis: relative error",
        "roots of the characteristic polynomial",
        relative(np.sort_complex(found.closed), upper(of_levitator(Model(levitator)))),
        1e-8,
    )
    own = levitator.bearings[0]
    grows = np.sqrt(own.force_displacement[0] / 12.0)
    lags = [-1.0 / levitator.amplifier.time_constant, -1.0 / levitator.actuator.time_constant]
    assert_allclose(np.sort(found.open.real), np.sort([grows, -grows, *lags]), rtol=1e-9)
    assert np.sum(found.open.real > 0.0) == 1


def test_regions_are_those_of_the_roots_under_the_covariance(levitator):
    """By central differences of the polynomial's roots, which know nothing of eigenvectors."""
    model = Model(levitator)
    correlated = np.array([[1.0, 0.7, 0.0], [0.7, 1.0, 0.2], [0.0, 0.2, 1.0]]) * np.outer(model.theta, model.theta)
    model = model.with_covariance(1e-4 * correlated)
    found = ambid.pole_map(model)
    for pole, spread in zip(found.closed, found.covariance, strict=True):
        slopes = []
        for k, value in enumerate(model.theta):
            step = 1e-5 * value * np.eye(3)[k]
            ends = [of_levitator(model.with_theta(model.theta + sign * step)) for sign in (1, -1)]
            near = [end[np.argmin(np.abs(end - pole))] for end in ends]
            slopes.append((near[0] - near[1]) / (2e-5 * value))
        parts = np.array([np.real(slopes), np.imag(slopes)])
        assert_allclose(spread, parts @ model.covariance @ parts.T, rtol=1e-5, atol=1e-7 * abs(pole) ** 2 * 1e-4)


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_slopes_of_the_poles_are_those_of_differences(levitator, implementation):
    rig = levitator.replace(controller=levitator.controller.model_copy(update={"implementation": implementation}))
    model = Model(rig)
    modes = model.loop.modes(model.theta, range(3))
    for k, value in enumerate(model.theta):
        step = 1e-5 * value * np.eye(3)[k]
        ends = [model.loop.modes(model.theta + sign * step).poles for sign in (1, -1)]
        for pole, slope in zip(modes.poles, modes.slopes[:, k], strict=True):
            near = [end[np.argmin(np.abs(end - pole))] for end in ends]
            assert abs((near[0] - near[1]) / (2e-5 * value) - slope) * value < 1e-4 * abs(pole)


def test_draws_of_the_parameters_lie_in_the_regions(levitator, validated):
    model = Model(levitator)
    model = model.with_covariance(np.diag((0.002 * model.theta) ** 2))
    found = ambid.pole_map(model)
    k = int(np.argmax(found.frequency_hz))
    pole, precision = found.closed[k], np.linalg.inv(found.covariance[k])
    draws = np.random.default_rng(1).multivariate_normal(model.theta, model.covariance, 2000)
    inside = 0
    for theta in draws:
        roots = of_levitator(model.with_theta(theta))
        off = roots[np.argmin(np.abs(roots - pole))] - pole
        inside += np.array([off.real, off.imag]) @ precision @ [off.real, off.imag] < 5.991
    validated(
        "95 % region of a pole, 2000 draws of the parameters: deviation of its coverage from 0.95",
        "roots of the characteristic polynomial; 4 binomial standard deviations",
        inside / len(draws) - 0.95,
        0.02,
    )


def test_poles_of_four_axes_are_those_of_an_independent_bench():
    bench = VirtualBench()
    assert_allclose(
        np.sort_complex(ambid.pole_map(Model(bench.rig())).closed),
        upper(np.linalg.eigvals(bench.continuous()[0])),
        rtol=1e-6,
    )


def test_without_a_covariance_nothing_is_claimed(levitator):
    found = ambid.pole_map(Model(levitator))
    assert np.isnan(found.covariance).all()
    shown = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert all(own["covariance"] is None for own in shown["closed"])


def test_what_is_printed_is_read_as_it_is(levitator, golden):
    own = ambid.pole_map(Model(levitator))
    pair = replace(own, closed=own.closed[:1].real - 1753.1 + 2e-12j, covariance=own.covariance[:1])
    assert f"{pair.closed[0].real:.5g} (double)" in str(pair)
    for unstable in ([100.0 + 0j], [100.0 + 0j, 90.0]):
        golden.holds(replace(own, open=np.array(unstable)).summary()[0])


def test_nonlinear_effects_are_left_out_and_told(levitator):
    model = Model(levitator).add("flux_saturation")
    found = ambid.pole_map(model)
    assert_allclose(found.closed, ambid.pole_map(Model(levitator)).closed, rtol=1e-12)
    assert [own.values for own in found.findings if own.kind is NOT_LINEAR] == [{"effects": ["flux_saturation"]}]


CENTRE, MAGNETS, SENSORS = 0.43, 0.23, 0.29
"""Of the symmetric bench: its middle, and the arms of magnets and sensors [m]."""


def rigid_body(rotor):
    """Mass, transverse inertia about the middle and polar inertia, of solid cylinders and disks."""
    mass, transverse, polar, z = 0.0, 0.0, 0.0, 0.0
    for section in rotor.section:
        radius, length = 0.5 * section.outer_diameter, section.length
        m, at = rotor.material.density * np.pi * radius**2 * length, z + 0.5 * length - CENTRE
        mass, polar, z = mass + m, polar + 0.5 * m * radius**2, z + length
        transverse += m * (0.25 * radius**2 + length**2 / 12.0 + at**2)
    for disk in rotor.disk:
        mass, polar = mass + disk.mass, polar + disk.polar_inertia
        transverse += disk.transverse_inertia + disk.mass * (disk.position - CENTRE) ** 2
    return mass, transverse, polar


@pytest.fixture(scope="module")
def rigid():
    """The bench without bending, its bearings alike, so that it moves along and tilts by itself."""
    rig = ambid.Rig.load(BENCH)
    alike = {"force_current": (200.0, 200.0), "force_displacement": (2.4e6, 2.4e6), "tilt": 30.0}
    return rig.replace(
        rotor=rig.rotor.model_copy(update={"flexible_modes": 0, "bending_frequencies_hz": None}),
        bearings=[bearing.model_copy(update=alike) for bearing in rig.bearings],
    )


def whirling(rig, speed):
    """Frequency [Hz] and direction of every swinging root of translation and tilting, in x + j y."""
    mass, transverse, polar = rigid_body(rig.rotor)
    lags = [rig.amplifier.time_constant, rig.actuator.time_constant]
    found = []
    for inertia, moment, magnets, sensors in ((mass, 0.0, 1.0, 1.0), (transverse, polar * speed, MAGNETS, SENSORS)):
        K_i, K_s = 2.0 * magnets * sensors * 200.0, 2.0 * magnets**2 * 2.4e6
        roots = np.roots(characteristic(rig.controller, lags, inertia, K_i, K_s, moment))
        ratio = -roots.real / np.abs(roots)
        roots = roots[(ratio < 0.7) & (np.abs(roots.imag) > 1.0)]
        found += [(abs(root.imag) / (2.0 * np.pi), np.sign(root.imag) if moment else None) for root in roots]
    return sorted(found, key=lambda own: own[0])


def test_whirl_of_a_rigid_rotor_is_that_of_its_complex_polynomial(rigid, validated):
    """I s^2 - j I_p w s - 2 a^2 K_s + 2 a b K_i H(s): roots above the axis turn forward, those below backward."""
    found = ambid.campbell(Model(rigid), [0.0, 300.0, 600.0, 900.0])
    for k, speed in enumerate(found.speed):
        expected = whirling(rigid, speed)
        assert len(expected) >= 4
        order = np.argsort(found.frequency_hz[k])
        validated(
            "Campbell diagram of a rigid rotor in its loop, up to 900 rad/s: relative error",
            "roots of the complex polynomial of translation and tilt",
            relative(found.frequency_hz[k, order], [frequency for frequency, _ in expected]),
            1e-6,
        )
        for way, (_, shown) in zip(found.direction[k, order], expected, strict=True):
            if shown is not None:
                assert way == pytest.approx(shown, abs=1e-3)
    split = whirling(rigid, 900.0)[-1][0] - whirling(rigid, 900.0)[-2][0]
    assert abs(split) > 1.0


def test_branches_are_followed_and_named(rigid):
    found = ambid.campbell(Model(rigid), np.linspace(0.0, 900.0, 31))
    assert np.isfinite(found.frequency_hz).all()
    tilting = [k for k, own in enumerate(found.frequency_hz.T) if np.ptp(own) > 0.1]
    assert sorted(found.whirls[k] for k in tilting) == ["backward", "forward"]
    for k in tilting:
        steps = np.diff(found.frequency_hz[:, k])
        assert (steps > 0.0).all() if found.whirls[k] == "forward" else (steps < 0.0).all()


def test_critical_speeds_are_where_a_branch_meets_the_rotation(rigid):
    found = ambid.campbell(Model(rigid), np.linspace(0.0, 900.0, 31))
    assert len(found.critical) == found.frequency_hz.shape[1]
    for own in found.critical:
        nearest = min(abs(2.0 * np.pi * frequency - own.speed) for frequency, _ in whirling(rigid, own.speed))
        assert nearest < 1e-3 * own.speed


def test_measured_speeds_are_those_of_the_operating_points(rigid):
    turning = [rigid.replace(speed=speed) for speed in (300.0, 600.0)]
    model = Model(rigid, points=turning)
    model = model.with_covariance(np.diag((0.01 * model.theta) ** 2))
    found = ambid.campbell(model)
    assert found.speed[-1] == pytest.approx(750.0)
    assert {own.speed for own in found.measured} == {0.0, 300.0, 600.0}
    for own in found.measured:
        nearest = min(abs(own.frequency_hz - frequency) for frequency, _ in whirling(rigid, own.speed))
        assert nearest < 1e-5 * own.frequency_hz
        has_twin = own.speed == 0.0 or own.direction == 0.0
        assert np.isnan(own.std_error_hz) if has_twin else own.std_error_hz > 0.0
    by_themselves = [Model(own).with_values({"tau_e": 2.2e-4}) for own in turning]
    held = ambid.campbell(Model(rigid), measured=by_themselves)
    assert {own.speed for own in held.measured} == {300.0, 600.0}
    assert np.isnan([own.std_error_hz for own in held.measured]).all()


@pytest.mark.parametrize("speeds", [[0.0], [-1.0, 5.0], [0.0, 5.0, 5.0], [0.0, np.inf]], ids=str)
def test_speeds_that_make_no_diagram_are_refused(rigid, speeds, golden):
    with golden.raises(InputError):
        ambid.campbell(Model(rigid), speeds)


def test_one_axis_cannot_whirl(levitator, golden):
    with golden.raises(InputError):
        ambid.campbell(Model(levitator))


@pytest.mark.parametrize(("direction", "word"), [(1.0, "forward"), (-0.5, "backward"), (0.1, "planar")])
def test_words_of_whirl(direction, word):
    assert whirl_of(direction) == word


def test_poles_of_a_delay_are_no_natural_frequencies(rigid):
    """Their frequencies lie beyond half the sample rate, and no part of the machine moves with them."""
    late = Model(rigid).add("loop_delay", {"delay": 2e-5})
    beyond = 0.5 * late.rig.sample_rate
    assert (late.poles().imag / (2.0 * np.pi) > beyond).any()
    found = ambid.campbell(late, speeds=np.linspace(0.0, 300.0, 7), measured=[late])
    assert np.nanmax(found.frequency_hz) < beyond
    assert all(own.frequency_hz < beyond for own in found.measured)


def test_rounding_is_no_growth():
    """The bending modes of an undamped rotor neither grow nor decay: real parts of 1e-12 beside 5 krad/s."""
    bench = VirtualBench(bending_damping=0.0)
    found = ambid.pole_map(Model(bench.rig()))
    bending = np.abs(found.open.imag - 2.0 * np.pi * bench.bending_hz) < 0.2 * 2.0 * np.pi * bench.bending_hz
    assert bending.sum() == 2
    assert_allclose(found.open[bending].real, 0.0, atol=1e-6)
    assert growing(found.open).sum() == 4
    rounded = np.array([1e-13 + 5e3j, -1e-12 + 5e3j, 2e-14 + 0j, 1e-3 + 0j, 0.1 + 5e3j, -30.0 + 0j])
    assert growing(rounded).tolist() == [False, False, False, True, True, False]
