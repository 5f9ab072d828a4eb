"""Nonlinear blocks of Delta: response, derivatives, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag

from ambid import _core
from ambid.errors import ModelError, UnstableLoopError
from reference.nonlinear_loop import (
    BIAS,
    DT,
    K_I,
    K_S,
    KINDS,
    LOOPS,
    MASS,
    TAU_E,
    Plant,
    excitation,
    law,
    machine,
)


def worst(found, expected):
    """Largest error of each column relative to its peak, the worst of them."""
    return np.max(np.abs(found - expected).max(axis=0) / np.abs(expected).max(axis=0))


@pytest.mark.parametrize("loop", ["analog", "digital", "late", pytest.param("delayed", marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_response_and_derivatives_are_those_of_an_adaptive_integrator(kind, loop, validated):
    plant, u = KINDS[kind](**LOOPS[loop]), excitation(24)
    expected, slopes = plant.slopes(u)
    assert worst(plant.core().simulate(plant.theta, u), expected) < 1e-6
    y, jacobian = plant.core().sensitivity(plant.theta, list(range(len(plant.theta))), u)
    validated(
        "Response of loops with saturation, a limit, hysteresis or polynomial forces: error relative to the peak",
        "SciPy {scipy} (DOP853, tolerance 1e-11)",
        worst(y, expected),
        1e-6,
    )
    validated(
        "Derivatives of these responses by every parameter: error relative to the peak",
        "four-point differences of responses by SciPy {scipy}",
        worst(jacobian, slopes),
        3e-6,
    )
    linear = plant.core().discrete(plant.theta)
    x, y = np.zeros(len(linear[0])), []
    for row in u:
        y.append(linear[2] @ x + linear[3] @ row)
        x = linear[0] @ x + linear[1] @ row
    assert worst(np.array(y), expected) > 1e-3, "this loop is hardly nonlinear"


def table_of(force, n):
    """A table of `force` fine enough to stand for it, and the same force as a polynomial."""
    x = np.linspace(-3.0, 3.0, n)
    s = np.linspace(-2e-4, 2e-4, n)
    block = {"law": "table", "parameters": {"g": 3}, "first": [x[0], s[0]], "spacing": [x[1] - x[0], s[1] - s[0]]}
    return block | {"values": force(x[:, None], s[None, :])}


def test_tables_stand_for_the_function_that_they_sample():
    port = {"z": [{"i_f": 1.0}, {"s": 1.0}], "w": {"v": 1 / MASS}}
    block = table_of(lambda i, s: 10.0 * i**3 + 3e10 * i * s**2, 121)
    as_table = machine([port], [None], [block], (1.0,)).core()
    terms = {
        "law": "polynomial",
        "exponents": [[3, 0], [1, 2]],
        "parameters": {},
        "constants": {"c0": 10.0, "c1": 3e10},
    }
    as_terms = machine([port], [None], [terms], (1.0,)).core()
    theta, u = np.array([180.0, 1.6e6, 4e-4, 1.0]), excitation(300)
    assert worst(as_table.simulate(theta, u), as_terms.simulate(theta, u)) < 1e-4

    grid = np.linspace(-1.0, 1.0, 9)
    values_1d = 30.0 * np.sin(2.0 * grid)
    values = CubicSpline(grid, values_1d, bc_type="natural")

    @law(1)
    def spline(theta, z):
        inside = np.clip(z[0], grid[0], grid[-1])
        return theta[3] * (values(inside) + values(inside, 1) * (z[0] - inside))

    block = {"law": "table", "parameters": {"g": 3}, "first": [-1.0], "spacing": [0.25], "values": values_1d}
    plant = machine([{"z": [{"i_f": 1.0}], "w": {"v": 1 / MASS}}], [spline], [block], (1.0,))
    u = excitation(24)
    y, jacobian = plant.core().sensitivity(theta, [0, 1, 2, 3], u)
    expected, slopes = plant.slopes(u)
    assert worst(y, expected) < 1e-6
    assert worst(jacobian, slopes) < 3e-6


ZERO = {"unsaturated": [3], "tanh": [3], "power": [3], "limit": [3], "hysteresis": [3, 4, 5], "polynomials": None}


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("kind", [kind for kind, places in ZERO.items() if places])
def test_without_strength_the_loop_is_the_linear_one(kind, loop):
    plant, u = KINDS[kind](**LOOPS[loop]), excitation(400)
    theta = plant.theta.copy()
    theta[ZERO[kind]] = 0.0
    A, B, C, D_ = plant.matrices
    bare = Plant((A, B[:, :4], C[:5], D_[:5, :4]), [], [], theta, plant.digital)
    free = [0, 1, 2] + ([len(theta) - 1] if "late" in LOOPS[loop] else [])
    y, jacobian = plant.core().sensitivity(theta, free, u)
    expected, slopes = bare.core().sensitivity(theta, free, u)
    assert worst(y, expected) < 1e-10
    assert worst(jacobian, slopes) < 1e-6


@pytest.mark.parametrize("amplitude", [1e1, 1e3, 1e8, 1e300])
@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_loud_excitation_gives_numbers_or_an_error(kind, loop, amplitude):
    plant = KINDS[kind](**LOOPS[loop])
    try:
        y, jacobian = plant.core(substeps=2).sensitivity(plant.theta, [0, 1, 2, 3], excitation(400, amplitude))
    except UnstableLoopError:
        return
    assert np.isfinite(y).all()
    assert np.isfinite(jacobian).all()


def van_der_pol(push, hold, **digital):
    """A force that drives small motion on, and holds large motion back."""

    @law(1)
    def force(theta, z):
        return theta[3] * z[0] + theta[4] * z[0] ** 3

    block = {"law": "polynomial", "exponents": [[1], [3]], "parameters": {"c0": 3, "c1": 4}, "constants": {}}
    return machine([{"z": [{"v": 1.0}], "w": {"v": 1.0 / MASS}}], [force], [block], (push, hold), **digital)


@pytest.mark.parametrize("loop", LOOPS)
def test_a_loop_that_is_unstable_at_rest_and_bounded_is_followed(loop):
    plant, u = van_der_pol(1e4, -1e7, **LOOPS[loop]), excitation(24)
    core, theta = plant.core(), plant.theta
    assert core.poles(theta).real.max() > 400.0
    expected, slopes = plant.slopes(u)
    y, jacobian = core.sensitivity(theta, list(range(len(theta))), u)
    assert worst(y, expected) < 1e-6
    assert worst(jacobian, slopes) < 3e-6
    long = excitation(2000)
    assert np.abs(core.simulate(theta, long)[:, 0]).max() < 1e-4
    assert_allclose(core.settled(theta, [], long, 1000)[0], core.simulate(theta, long)[-1000:], rtol=1e-9, atol=1e-15)


def test_substeps_are_those_that_all_of_an_excitation_needs():
    """This motion goes on growing after what begins it, the loudest stretch of an even excitation."""
    plant, u = van_der_pol(2e4, -2e8), excitation(1500, 1e-4)
    exact = plant.core(substeps=128).simulate(plant.theta, u)
    assert worst(plant.core().simulate(plant.theta, u), exact) < 2e-7


def test_a_loop_that_leaves_all_bounds_is_refused(golden):
    plant = van_der_pol(1e5, 1e7)
    with golden.raises(UnstableLoopError):
        plant.core().simulate(plant.theta, excitation(1000))


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("kind", KINDS)
def test_stepper_is_the_simulation(kind, loop):
    plant, u = KINDS[kind](**LOOPS[loop]), excitation(200)
    core = plant.core(substeps=8)
    expected = core.simulate(plant.theta, u)
    stepper = _core.Stepper(core, plant.theta)
    np.testing.assert_array_equal(stepper.run(u), expected)
    stepper.reset()
    np.testing.assert_array_equal(np.array([stepper.step(row) for row in u]), expected)
    assert worst(_core.Stepper(plant.core(), plant.theta).run(u), expected) < 1e-4


def test_normal_equations_are_those_of_the_sensitivities():
    plant, u = KINDS["tanh"](), excitation(500)
    core, free = plant.core(), [0, 1, 2, 3, 4]
    y, jacobian = core.sensitivity(plant.theta, free, u)
    weights = np.array([1e6, 1e2])
    z = y + np.random.default_rng(1).standard_normal(y.shape) / weights
    data = [_core.Data(core, u, z, weights)] * 2
    hessian, gradient, squares = _core.normal_equations(core, plant.theta, free, data)
    residual, slopes = y - z - (y - z).mean(axis=0), jacobian - jacobian.mean(axis=0)
    weights = weights**2
    np.testing.assert_allclose(squares, 2 * weights * (residual**2).sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(gradient, 2 * np.einsum("o,kop,ko->p", weights, slopes, residual), rtol=1e-6)
    np.testing.assert_allclose(hessian, 2 * np.einsum("o,kop,koq->pq", weights, slopes, slopes), rtol=1e-6)


def test_a_plane_without_blocks_keeps_its_path():
    plant, u = KINDS["tanh"](), excitation(300)
    A, B, C, D_ = plant.matrices
    bare = (A, B[:, :4], C[:5], D_[:5, :4])
    # side by side: u, w of the gains, w of the block; y, i_c, z of the gains, z of the block
    columns = [0, 5, 1, 2, 3, 6, 7, 8, 4]
    rows = [0, 1, 7, 8, 2, 3, 4, 9, 10, 11, 5, 6]
    big = [block_diag(m, other) for m, other in zip(plant.matrices, bare, strict=True)]
    matrices = (big[0], big[1][:, columns], big[2][rows], np.ascontiguousarray(big[3][np.ix_(rows, columns)]))

    gains = [(K_I, 1.0, 1), (K_S, 1.0, 1), (TAU_E, 1.0, -1)]
    two = _core.ClosedLoop(matrices, gains * 2, 5, DT, None, plant.blocks)
    assert two.parts == 2
    alone = _core.ClosedLoop(bare, gains, 5, DT)
    y = two.simulate(plant.theta, np.hstack([u, u]))
    np.testing.assert_array_equal(y[:, 2:], alone.simulate(plant.theta, u))
    np.testing.assert_array_equal(y[:, :2], plant.core().simulate(plant.theta, u))


WRONG_BLOCKS = {
    "law": {"law": "force"},
    "curve": {"curve": "cubic"},
    "bias": {"constants": {"bias": -1.0}},
    "unknown constant": {"constants": {"bias": BIAS, "bais": 1.0}},
    "missing parameter": {"parameters": {"K_i": 0, "K_s": 1}},
    "unknown parameter": {"parameters": {"K": 0}},
    "index": {"parameters": {"K_i": 9, "K_s": 1, "nu": 2, "sigma": 3}},
    "no exponents": {"law": "polynomial", "parameters": {}, "constants": {}},
    "no values": {"law": "table", "parameters": {}, "constants": {"g": 1.0}},
}


@pytest.mark.parametrize("name", WRONG_BLOCKS)
def test_wrong_blocks_are_refused(name, golden):
    plant = KINDS["tanh"]()
    plant.blocks[0] |= WRONG_BLOCKS[name]
    with golden.raises(ModelError):
        plant.core()


def test_an_algebraic_loop_of_blocks_is_refused(golden):
    plant = KINDS["polynomials"]()
    plant.matrices[3][5, 6] = 1.0  # the first block reads the third, which reads the first
    with golden.raises(ModelError):
        plant.core().simulate(plant.theta, excitation(5))


def test_a_displacement_that_follows_a_command_at_once_is_refused(golden):
    plant = KINDS["limit"](delay=0.0)
    plant.matrices[3][0, 4] = 1e-9  # what the amplifier lacks is seen by the sensor
    plant.theta[4] = 100.0  # noise that does not reach the limit from rest
    with golden.raises(ModelError):
        plant.core().simulate(plant.theta, excitation(5))
