"""The rotor room against closed forms, ROSS 2.3.0 and its own mesh; then what it refuses."""

import json
import tomllib

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigvals

from ambid.errors import RigError
from ambid.rig import FiniteElementRotor, MatrixRotor, ModalRotor, PointMassRotor
from ambid.rotor import BeamModel, assemble, matrix_model, reduce, reduced_rotor
from ambid.rotor.assembly import place_of
from ambid.rotor.beam import beam_element, both_planes, plane_bases, shear_coefficient
from places import BENCH, TESTS
from validated import relative

ROSS = json.loads((TESTS / "reference" / "ross_rotors.json").read_text())
STEEL = {"density": 7850.0, "youngs_modulus": 2.06e11, "poisson_ratio": 0.3}
NODES = [0.14, 0.2, 0.66, 0.72]


def shaft(sections, disks=(), material=STEEL, flexible_modes=3, **options) -> FiniteElementRotor:
    """Finite-element rotor from (length, outer, inner) and (position, mass, transverse, polar)."""
    section = ("length", "outer_diameter", "inner_diameter")
    disk = ("position", "mass", "transverse_inertia", "polar_inertia")
    return FiniteElementRotor(
        material=material,
        section=[dict(zip(section, values, strict=True)) for values in sections],
        disk=[dict(zip(disk, values, strict=True)) for values in disks],
        flexible_modes=flexible_modes,
        **options,
    )


def bench(flexible_modes=3, **options) -> FiniteElementRotor:
    """Rotor of the bench, its measured frequencies and damping left out."""
    given = tomllib.loads(BENCH.read_text())["rotor"]
    shape = {key: given[key] for key in ("material", "section", "disk")}
    return FiniteElementRotor(**shape, flexible_modes=flexible_modes, **options)


def stepped(**options) -> FiniteElementRotor:
    reference = ROSS["rotor"]
    ends = np.cumsum([0.0, *(length for length, _, _ in reference["sections"])])
    disks = [(ends[end], *inertia) for end, *inertia in reference["disks"]]
    return shaft(reference["sections"], disks, reference["material"], **options)


def matrices(model: BeamModel, **changes) -> MatrixRotor:
    given = {"node_positions": model.z, "M": model.M, "K": model.K, "G": model.G, "flexible_modes": 2}
    return MatrixRotor(**given | changes)


def modes(**changes) -> ModalRotor:
    given = {
        "frequencies_hz": [0.0, 0.0, 500.0],
        "damping": [0.0, 0.0, 0.01],
        "positions": [0.1, 0.5],
        "shapes": [[0.12, 0.12], [-0.1, 0.1], [0.2, 0.2]],
    }
    return ModalRotor(**given | changes)


def whirl_rad_s(M, G, K, speed, forward):
    """Whirl frequencies of an isotropic rotor in r = x + j y, ascending; forward ones turn from x to y."""
    x, y = plane_bases(len(M) // 4)
    to_complex = (x - 1j * y).conj().T / np.sqrt(2)
    M, G, K = (to_complex @ matrix @ to_complex.conj().T for matrix in (M, G, K))
    inverse = np.linalg.inv(M)
    state = np.block([[np.zeros_like(M), np.eye(len(M))], [-inverse @ K, -speed * inverse @ G]])
    whirl = eigvals(state).imag
    return np.sort(whirl[whirl > 0.0] if forward else -whirl[whirl < 0.0])


# Reference: ROSS 2.3.0 ------------------------------------------------------------------------------------------------


def test_bench_rotor_agrees_with_ross(validated):
    """Values of ROSS with 24 elements a section, Cowper's shear; 0.1 % leaves room for the mesh."""
    model = assemble(bench(), NODES)
    assert model.mass == pytest.approx(69.000, rel=1e-5)
    assert model.centre == pytest.approx(0.4300, rel=1e-6)
    assert model.transverse_inertia == pytest.approx(3.4288, rel=1e-4)
    frequencies = reduce(model, 3).frequencies_rad_s / (2.0 * np.pi)
    validated(
        "Free bending frequencies of a rotor with disks: relative error",
        "ROSS 2.3.0, 24 elements a section",
        relative(frequencies[2:], [553.79, 1382.73, 2270.96]),
        1e-3,
    )


@pytest.mark.parametrize("name", ["M", "G", "K"])
def test_hollow_element_agrees_with_ross_entry_by_entry(name, validated):
    """The same formulas in the same order of freedoms: equal to rounding."""
    keys = ("length", "outer_diameter", "inner_diameter", "density", "youngs_modulus", "poisson_ratio")
    ours = dict(zip("MGK", both_planes(beam_element(*(ROSS["element"][key] for key in keys))), strict=True))[name]
    theirs = np.array(ROSS["element"][name])
    validated(
        "M, G and K of a hollow Timoshenko element: error of each entry, relative to the largest",
        "ROSS 2.3.0",
        (ours - theirs) / np.max(np.abs(theirs)),
        1e-10,
    )
    assert_allclose(ours, theirs, rtol=1e-10, atol=1e-12 * np.max(np.abs(theirs)))


def test_stepped_hollow_rotor_agrees_with_ross_at_rest():
    reference = ROSS["rotor"]
    model = assemble(stepped(), [])
    assert model.mass == pytest.approx(reference["mass_kg"], rel=1e-9)
    assert model.centre == pytest.approx(reference["centre_m"], rel=1e-9)
    assert model.transverse_inertia == pytest.approx(reference["transverse_inertia_kg_m2"], rel=1e-9)
    # 16 elements a section there, a converged mesh here: 0.05 %, what the mesh promises.
    assert_allclose(reduce(model, 3).frequencies_rad_s[2:], reference["frequencies_rad_s"][:3], rtol=5e-4)


@pytest.mark.parametrize("direction", ["forward", "backward"])
@pytest.mark.parametrize("index", [0, 1])
def test_stepped_hollow_rotor_agrees_with_ross_when_it_turns(direction, index, validated):
    reference = ROSS["rotor"]
    model = assemble(stepped(), [])
    whirl = whirl_rad_s(model.M, model.G, model.K, reference["speeds_rad_s"][index], direction == "forward")
    bending = whirl[whirl > 0.6 * reference["frequencies_rad_s"][0]]
    validated(
        "Forward and backward whirl of a stepped hollow rotor that turns: relative error",
        "ROSS 2.3.0, 16 elements a section",
        relative(bending[:3], reference[f"{direction}_rad_s"][index]),
        5e-4,
    )


def test_reduced_gyroscopic_matrix_keeps_the_whirl_split():
    """Ten modes a plane reproduce the whirl of the full model to 0.1 % (truncation)."""
    reference = ROSS["rotor"]
    rotor = reduce(assemble(stepped(flexible_modes=8), []), 8)
    zero, squares = np.zeros((20, 20)), np.diag(np.tile(rotor.frequencies_rad_s**2, 2))
    state = np.block([[zero, np.eye(20)], [-squares, -reference["speeds_rad_s"][0] * rotor.gyroscopic]])
    whirl = np.sort(np.abs(eigvals(state).imag))[::2]
    pair = sorted([reference["forward_rad_s"][0][0], reference["backward_rad_s"][0][0]])
    assert_allclose(whirl[whirl > 0.6 * reference["frequencies_rad_s"][0]][:2], pair, rtol=1e-3)


# Closed forms ---------------------------------------------------------------------------------------------------------


def test_slender_free_beam_has_the_frequencies_of_euler_and_bernoulli(validated):
    length, diameter = 5.0, 0.01
    model = assemble(shaft([(length, diameter, 0.0)]), [])
    root = np.sqrt(STEEL["youngs_modulus"] * diameter**2 / 16.0 / STEEL["density"])  # sqrt(E I / (rho A))
    expected = np.array([4.730041, 7.853205, 10.995608]) ** 2 / length**2 * root
    validated(
        "Frequencies of a slender free beam: relative error",
        "Euler and Bernoulli: (k l)^2 = 4.730^2, 7.853^2, 10.996^2",
        relative(reduce(model, 3).frequencies_rad_s[2:], expected),
        5e-4,
    )


@pytest.mark.parametrize("inner", [0.0, 0.06])
def test_cantilever_deflects_by_bending_and_shear(inner, validated):
    length, outer, force = 0.3, 0.1, 1e3
    K = assemble(shaft([(length, outer, inner)]), [0.11]).K
    area, second_moment = np.pi / 4 * (outer**2 - inner**2), np.pi / 64 * (outer**4 - inner**4)
    shear_modulus = STEEL["youngs_modulus"] / (2.0 * (1.0 + STEEL["poisson_ratio"]))
    kappa = shear_coefficient(outer, inner, STEEL["poisson_ratio"])
    expected = force * length**3 / (3.0 * STEEL["youngs_modulus"] * second_moment)
    expected += force * length / (kappa * shear_modulus * area)
    load = np.zeros(len(K) - 4)
    load[-4:-2] = force, -force
    deflection = np.linalg.solve(K[4:, 4:], load)
    validated(
        "Deflection of a short cantilever by bending and shear: relative error",
        "F l^3/(3 E I) + F l/(kappa G A), kappa of Cowper, J. Appl. Mech. 33, 1966",
        relative(deflection[-4:-2], [expected, -expected]),
        1e-9,
    )


def test_shear_coefficient_has_its_published_limits():
    """Solid, and thin-walled tube, 2 (1 + nu) / (4 + 3 nu) (Cowper 1966)."""
    assert shear_coefficient(0.1, 0.0, 0.3) == pytest.approx(6.0 * 1.3 / 8.8)
    assert shear_coefficient(0.1, 0.1 * (1 - 1e-9), 0.3) == pytest.approx(2.0 * 1.3 / 4.9)


@pytest.mark.parametrize("speed", [200.0, -200.0])
def test_conical_whirl_of_a_rigid_rotor_on_springs(speed, validated):
    """I_t w^2 - I_p speed w - k_theta = 0 forward, + backward; springs at z = 0 and z = length."""
    length, stiffness, polar = 0.4, 1e4, 0.9
    stiff = STEEL | {"youngs_modulus": 2e12}
    model = assemble(shaft([(length, 0.1, 0.0)], [(length / 2, 20.0, 0.5, polar)], stiff, flexible_modes=1), [])
    K = model.K.copy()
    for z in (0.0, length):
        at = 4 * place_of(z, model.z) + np.arange(2)
        K[at, at] += stiffness
    own_polar = STEEL["density"] * length * np.pi / 32 * 0.1**4
    inertia, spin = model.transverse_inertia, (polar + own_polar) * speed
    root = np.sqrt(spin**2 + 4.0 * inertia * 2.0 * stiffness * (length / 2) ** 2)
    for forward, expected in ((True, (spin + root) / (2 * inertia)), (False, (root - spin) / (2 * inertia))):
        rigid = whirl_rad_s(model.M, model.G, K, speed, forward)[:2]
        cylindrical = np.sqrt(2.0 * stiffness / model.mass)
        validated(
            "Cylindrical and conical whirl of a stiff rotor on springs: relative error",
            "I_t w^2 -+ I_p W w - k = 0",
            relative(rigid, sorted([cylindrical, expected])),
            1e-4,  # the shaft bends a little
        )


# Mesh and reduction ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "rotor",
    [
        pytest.param(bench(), id="bench"),
        pytest.param(stepped(), id="stepped"),
        pytest.param(bench(flexible_modes=6), id="six modes", marks=pytest.mark.slow),
    ],
)
def test_kept_frequencies_do_not_change_when_every_element_is_halved(rotor):
    model = assemble(rotor, [0.07])
    kept = reduce(model, rotor.flexible_modes).frequencies_rad_s[2:]
    halved = assemble(rotor, [0.07, *(model.z[1:] + model.z[:-1]) / 2])
    assert len(halved.z) >= 2 * len(model.z) - 1
    assert_allclose(kept, reduce(halved, rotor.flexible_modes).frequencies_rad_s[2:], rtol=5e-4)


def test_a_node_next_to_another_does_not_spoil_the_modes():
    plain = reduce(assemble(bench(), NODES), 3)
    close = reduce(assemble(bench(), [*NODES, 0.14 + 2e-6]), 3)
    assert_allclose(close.frequencies_rad_s, plain.frequencies_rad_s, rtol=1e-6)
    assert_allclose(close.shape(0.66), plain.shape(0.66), rtol=1e-5)


def test_left_and_right_matrices_are_biorthogonal_and_diagonalise():
    model = assemble(bench(), NODES)
    rotor = reduce(model, 3, modal_damping=0.004)
    assert_allclose(rotor.T_L @ rotor.T_R, np.eye(10), atol=1e-12)
    squares = np.tile(rotor.frequencies_rad_s**2, 2)
    assert_allclose(rotor.T_L @ np.linalg.solve(model.M, model.K @ rotor.T_R), np.diag(squares), atol=1e-6 * squares[2])
    assert_allclose(rotor.gyroscopic, -rotor.gyroscopic.T, atol=0.0)
    assert_allclose(rotor.damping, [0.0, 0.0, 0.004, 0.004, 0.004])


def test_rigid_modes_are_exact():
    model = assemble(bench(), NODES)
    rotor = reduce(model, 0)
    assert rotor.frequencies_rad_s.tolist() == [0.0, 0.0]
    expected = [1.0 / np.sqrt(model.mass), (0.72 - model.centre) / np.sqrt(model.transverse_inertia)]
    assert_allclose(rotor.shape(0.72), expected, rtol=1e-9)


def test_shape_is_what_both_planes_show():
    model = assemble(bench(), NODES)
    rotor = reduce(model, 2)
    for plane in (0, 1):
        row = rotor.T_R[4 * place_of(0.66, model.z) + plane]
        assert_allclose(row[4 * plane : 4 * plane + 4], rotor.shape(0.66), atol=1e-15)
        assert_allclose(np.delete(row, slice(4 * plane, 4 * plane + 4)), 0.0, atol=1e-15)


def test_measured_frequencies_replace_the_first_ones_and_shapes_stay():
    plain = reduced_rotor(bench(), NODES)
    scaled = reduce(assemble(bench(), NODES), 3, [0.001, 0.002, 0.003], [560.0])
    assert scaled.frequencies_rad_s[2] == pytest.approx(2 * np.pi * 560.0)
    assert_allclose(scaled.frequencies_rad_s[3:], plain.frequencies_rad_s[3:])
    assert_allclose(scaled.shape(0.2), plain.shape(0.2))
    assert_allclose(scaled.damping, [0.0, 0.0, 0.001, 0.002, 0.003])
    rigid = reduced_rotor(bench(0, bending_frequencies_hz=[560.0]), NODES)
    assert len(rigid.frequencies_rad_s) == 2


@pytest.mark.parametrize("off", [-1e-16, 1e-16, 5e-7])
def test_ends_of_the_shaft_are_on_it_whatever_rounding_does(off, golden):
    """A sum of lengths in another order is another number; both are one place."""
    sections = [(length, 0.05, 0.0) for length in (0.1178, 0.1931, 0.1046, 0.1734)]

    def with_disk_at(z):
        return shaft(sections, [(z, 1.0, 1e-3, 2e-3)], flexible_modes=1)

    end, exact = 0.5889 + off, reduced_rotor(with_disk_at(0.5889), [0.0, 0.5889])
    assert_allclose(reduced_rotor(with_disk_at(end), [0.0, end]).shape(end), exact.shape(0.5889), rtol=1e-5)
    with golden.raises(RigError):
        with_disk_at(end + 2e-6)


# Other kinds of rotor -------------------------------------------------------------------------------------------------


def test_matrices_give_the_same_modes_as_the_finite_elements_they_came_from():
    model = assemble(bench(2), NODES)
    ours, expected = reduced_rotor(matrices(model), NODES), reduce(model, 2)
    assert_allclose(ours.frequencies_rad_s, expected.frequencies_rad_s)
    assert_allclose(ours.gyroscopic, expected.gyroscopic, atol=1e-12)
    assert_allclose(ours.shape(0.2), expected.shape(0.2))


def test_matrices_without_g_do_not_couple_the_planes():
    assert not np.any(matrix_model(matrices(assemble(bench(), NODES), G=None)).G)


def test_a_damping_matrix_in_proportion_to_mass_and_stiffness_is_mass_damping_and_modal_damping():
    """C = 3 M + 2e-5 K damps every mode at 3 + 2e-5 w^2, in either plane and the rigid motions too."""
    model = assemble(bench(2), NODES)
    rotor = reduced_rotor(matrices(model, C=3.0 * model.M + 2e-5 * model.K), NODES)
    w = np.tile(rotor.frequencies_rad_s, 2)
    assert_allclose(rotor.coupling(0.0), np.diag(3.0 + 2e-5 * w**2), atol=1e-6 * w.max() ** 2 * 2e-5)
    assert_allclose(rotor.coupling(50.0) - rotor.coupling(0.0), 50.0 * rotor.gyroscopic, atol=1e-9)
    one = rotor.in_one_plane()
    assert_allclose(one.coupling(50.0), rotor.coupling(0.0)[:4, :4])


def test_given_modes_are_taken_as_they_are():
    coupling = [[0.0, 0.0, 0.0], [0.0, 0.4, 0.1], [0.0, 0.1, 0.2]]
    rotor = reduced_rotor(modes(gyroscopic=coupling), [0.1])
    assert_allclose(rotor.frequencies_rad_s, [0.0, 0.0, 1000.0 * np.pi])
    assert_allclose(rotor.shape(0.5), [0.12, 0.1, 0.2])
    assert_allclose(rotor.gyroscopic[:3, 3:], coupling)
    assert_allclose(rotor.gyroscopic, -rotor.gyroscopic.T)
    assert_allclose(rotor.T_L @ rotor.T_R, np.eye(6))


def test_shape_between_nodes_is_that_of_a_mesh_with_a_node_there():
    at = [0.3, 0.4071]
    coarse, fine = reduced_rotor(bench(2), NODES), reduced_rotor(bench(2), [*NODES, *at])
    for z in at:
        assert_allclose(coarse.shape(z), fine.shape(z), rtol=1e-4, atol=1e-5)


def test_point_mass_has_one_plane_and_one_shape_everywhere():
    rotor = reduced_rotor(PointMassRotor(mass=4.0), [0.0, 0.3])
    assert (rotor.planes, rotor.T_R.shape, rotor.T_L.shape) == (1, (1, 1), (1, 1))
    assert rotor.shape(0.3).tolist() == [0.5]
    assert (rotor.T_L @ rotor.T_R).item() == pytest.approx(1.0)


# What is refused ------------------------------------------------------------------------------------------------------


WRONG_ROTORS = {
    "bearing off the shaft": lambda: assemble(bench(), [1.2]),
    "bearing before the shaft": lambda: assemble(bench(), [-0.1]),
    "disk off the shaft": lambda: assemble(shaft([(0.5, 0.1, 0.0)], [(0.6, 1.0, 0.1, 0.2)]), []),
    "too many modes": lambda: assemble(bench(100), []),
    "rad/s": lambda: reduced_rotor(bench(1, bending_frequencies_hz=[3479.6]), []),
    "too few dampings": lambda: reduce(assemble(bench(), []), 3, [0.1]),
    "shape off the shaft": lambda: reduced_rotor(bench(), NODES).shape(0.9),
    "no position of a mode": lambda: reduced_rotor(modes(), [0.3]),
    "falling frequencies": lambda: reduced_rotor(modes(frequencies_hz=[500.0, 0.0, 0.0]), []),
}


@pytest.mark.parametrize("name", WRONG_ROTORS)
def test_wrong_rotor_is_refused(name, golden):
    with golden.raises(RigError):
        WRONG_ROTORS[name]()


def _held(K):
    return K + 1e6 * np.eye(len(K))


def _stiffer_in_x(K):
    x, _ = plane_bases(len(K) // 4)
    return K + 1e-6 * x @ x.T @ K @ x @ x.T


def _cross_coupled(K):
    x, y = plane_bases(len(K) // 4)
    return K + 1e-6 * np.max(K) * (x @ y.T + y @ x.T)


WRONG_MATRICES = {
    "held": lambda m: {"K": _held(m.K)},
    "stiffer in x": lambda m: {"K": _stiffer_in_x(m.K)},
    "cross-coupled": lambda m: {"K": _cross_coupled(m.K)},
    "not skew": lambda m: {"G": np.abs(m.G)},
    "damping not symmetric": lambda m: {"C": m.M + m.G},
    "too many modes": lambda m: {"flexible_modes": 100},
}


@pytest.mark.parametrize("name", WRONG_MATRICES)
def test_wrong_matrices_are_refused(name, golden):
    model = assemble(bench(flexible_modes=0), NODES)
    with golden.raises(RigError):
        reduced_rotor(matrices(model, **WRONG_MATRICES[name](model)), [])


def test_many_sections_have_the_modes_that_all_eigenvalues_tell(monkeypatch):
    pieces = [(0.004, 0.03 + 0.01 * (k // 40 % 2), 0.0) for k in range(200)]
    quick = reduce(assemble(shaft(pieces), [0.4]), 3)
    monkeypatch.setattr("ambid.rotor.assembly._MANY", 10**9)
    slow = reduce(assemble(shaft(pieces), [0.4]), 3)
    assert_allclose(quick.frequencies_rad_s, slow.frequencies_rad_s, rtol=1e-9)
    assert_allclose(quick.shapes, slow.shapes, atol=1e-7 * np.abs(slow.shapes).max())


def test_more_sections_than_can_be_borne_are_refused(golden):
    with golden.raises(RigError):
        shaft([(0.001, 0.03, 0.0)] * 1001)
