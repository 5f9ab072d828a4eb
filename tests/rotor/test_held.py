"""Cones, supports and damping to ground against closed forms and ROSS 2.3.0."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid import Model, prbs
from ambid.errors import RigError
from ambid.loop.loop import open_plant
from ambid.rig import FiniteElementRotor, PointMassRotor, Rig, Support
from ambid.rotor import assemble, reduced_rotor
from ambid.rotor.beam import beam_element, conical_element, shear_coefficient
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from places import BENCH, TESTS

HELD = json.loads((TESTS / "reference" / "ross_rotors.json").read_text())["held"]
OF_ROSS = {"density": 7810.0, "youngs_modulus": 2.11e11, "poisson_ratio": 0.29}
STEEL = {"density": 7850.0, "youngs_modulus": 2.06e11, "poisson_ratio": 0.3}
RIG = Rig.load(BENCH)


def cone(length, first, last, inner=0.0, **more):
    section = {"length": length, "outer_diameter": first, "outer_diameter_end": last, "inner_diameter": inner}
    return FiniteElementRotor(material=STEEL, section=[section], **more)


def of_ross(**more):
    keys = ("length", "outer_diameter", "outer_diameter_end", "inner_diameter")
    disk, support = (
        ("position", "mass", "transverse_inertia", "polar_inertia"),
        ("position", "stiffness", "damping"),
    )
    return FiniteElementRotor(
        material=OF_ROSS,
        section=[dict(zip(keys, own, strict=True)) for own in HELD["cones"]],
        disk=[dict(zip(disk, own, strict=True)) for own in HELD["disks"]],
        support=[dict(zip(support, own, strict=True)) for own in HELD["supports"]],
        mass_damping=HELD["mass_damping"],
        flexible_modes=7,
        **more,
    )


def on_the_cones(speed):
    """The bench with the conical rotor in bearings of its own."""
    places = (0.05, 0.40)
    bearings = [
        bearing.model_copy(update={"position": z, "sensor_position": z})
        for bearing, z in zip(RIG.bearings, places, strict=True)
    ]
    return RIG.replace(rotor=of_ross(), bearings=tuple(bearings), speed=speed)


def poles_without_magnets(rig):
    """Of the rotor as the plant has it, forces of magnets left out, slowest first and one of each conjugate pair."""
    plant = open_plant(rig, ())
    values = {port.slot: 1.0 if port.power < 0 else 0.0 for port in plant.ports}
    poles = np.linalg.eigvals(plant.closed(values)[0])
    poles = poles[poles.imag > 1e-3]
    return poles[np.argsort(np.abs(poles))]


# Cones ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("inner", [0.0, 0.03])
def test_a_cone_of_one_diameter_is_a_cylinder(inner):
    material = STEEL.values()
    cylinder, same = beam_element(0.08, 0.07, inner, *material), conical_element(0.08, (0.07, 0.07), inner, *material)
    for ours, expected in zip(same, cylinder, strict=True):
        assert_allclose(ours, expected, atol=1e-13 * np.abs(expected).max())


def test_the_mass_and_the_inertias_of_a_frustum_are_exact():
    """Of radii a and b: m = pi rho h (a^2 + a b + b^2)/3, and the integrals of z and z^2 over it."""
    length, a, b = 0.4, 0.05, 0.02
    model = assemble(cone(length, 2 * a, 2 * b), [0.13])
    z = np.polynomial.Polynomial([0.0, 1.0])
    radius = a + (b - a) / length * z
    area, own = STEEL["density"] * np.pi * radius**2, STEEL["density"] * np.pi / 4.0 * radius**4

    def integral(of):
        return of.integ()(length)

    mass = STEEL["density"] * np.pi * length * (a**2 + a * b + b**2) / 3.0
    centre = integral(area * z) / mass
    assert model.mass == pytest.approx(mass, rel=1e-12)
    assert model.centre == pytest.approx(centre, rel=1e-12)
    assert model.transverse_inertia == pytest.approx(integral(area * (z - centre) ** 2 + own), rel=1e-12)
    tilt = np.column_stack([model.z, np.ones_like(model.z)]).ravel()
    assert tilt @ model.plane.polar @ tilt == pytest.approx(integral(2.0 * own), rel=1e-12)


def test_a_conical_cantilever_deflects_by_bending_and_shear():
    """F L^3/(3 E I) (d_root/d_tip), I at the root, and F L/(kappa G A) with the product of both diameters in A."""
    length, root, tip, force = 0.5, 0.08, 0.05, 1e3
    K = assemble(cone(length, root, tip), [0.11]).K
    shear_modulus = STEEL["youngs_modulus"] / (2.0 * (1.0 + STEEL["poisson_ratio"]))
    kappa = shear_coefficient(root, 0.0, STEEL["poisson_ratio"])
    expected = force * length**3 / (3.0 * STEEL["youngs_modulus"] * np.pi / 64.0 * root**4) * root / tip
    expected += force * length / (kappa * shear_modulus * np.pi / 4.0 * root * tip)
    load = np.zeros(len(K) - 4)
    load[-4:-2] = force
    assert_allclose(np.linalg.solve(K[4:, 4:], load)[-4:-2], expected, rtol=1e-7)


def test_a_cone_in_many_cylinders():
    """Bending frequencies of the cone are those of ever more steps, to 0.1 %."""
    ends = np.linspace(0.09, 0.05, 161)
    steps = [{"length": 0.5 / 160, "outer_diameter": d} for d in (ends[1:] + ends[:-1]) / 2.0]
    stepped = FiniteElementRotor(material=STEEL, section=steps, flexible_modes=3)
    ours, expected = (reduced_rotor(own, [0.0, 0.5]) for own in (cone(0.5, 0.09, 0.05, flexible_modes=3), stepped))
    assert_allclose(ours.frequencies_rad_s, expected.frequencies_rad_s, rtol=1e-3)


# ROSS -----------------------------------------------------------------------------------------------------------------


def test_cones_agree_with_ross():
    model = assemble(of_ross(), [])
    assert model.mass == pytest.approx(HELD["mass_kg"], rel=1e-9)
    assert model.centre == pytest.approx(HELD["centre_m"], rel=1e-5)
    assert model.transverse_inertia == pytest.approx(HELD["transverse_inertia_kg_m2"], rel=1e-4)


@pytest.mark.parametrize("index", [0, 1])
def test_a_held_rotor_has_the_poles_of_ross(index):
    """Frequency and damping of both rigid modes and two bending modes in both planes, at rest and turning."""
    rig = on_the_cones(HELD["speeds_rad_s"][index])
    expected = np.array([complex(*own) for own in HELD["poles_per_s"][index]])
    found = poles_without_magnets(rig)[: len(expected)]
    assert_allclose(np.abs(found), np.abs(expected), rtol=1e-3)
    assert_allclose(found.real, expected.real, rtol=1e-3)


# Closed forms ---------------------------------------------------------------------------------------------------------


def test_a_mass_on_a_spring_and_a_damper():
    """m s^2 + (m mass_damping + C) s + K = 0."""
    mass, rate, stiffness, damping = 12.0, 2.5, 4e5, 80.0
    support = [{"stiffness": stiffness, "damping": damping}]
    rig = ONE_AXIS.rig.replace(rotor=PointMassRotor(mass=mass, mass_damping=rate, support=support))
    expected = np.roots([mass, mass * rate + damping, stiffness])
    assert_allclose(poles_without_magnets(rig), expected[expected.imag > 0.0], rtol=1e-12)


def test_a_rigid_rotor_falls_as_slowly_as_its_damping_says():
    """Poles of a free rotor: 0 and -mass_damping of each rigid mode; 2 zeta w = mass_damping more of each other."""
    damped, free = (
        RIG.replace(rotor=RIG.rotor.model_copy(update={"mass_damping": own, "modal_damping": 0.01}))
        for own in (2.5, 0.0)
    )
    plants = [open_plant(rig, ()) for rig in (damped, free)]
    values = {port.slot: 1.0 if port.power < 0 else 0.0 for port in plants[0].ports}
    poles, without = (np.linalg.eigvals(plant.closed(values)[0]) for plant in plants)
    assert np.sum(np.abs(poles + 2.5) < 1e-6) == 4
    bending, of_free = (np.unique(np.round(own[own.imag > 1.0].real, 6)) for own in (poles, without))
    assert_allclose(bending, of_free - 1.25, rtol=1e-6)


# Another integrator ---------------------------------------------------------------------------------------------------


def test_the_loop_of_a_held_rotor_is_that_of_the_independent_simulator():
    support = (Support(position=0.31, stiffness=3e5, damping=200.0), Support(position=0.86, stiffness=-1e5))
    held = RIG.rotor.model_copy(update={"mass_damping": 4.0, "support": support})
    rig = RIG.replace(rotor=held, speed=300.0)
    truth, i_e = BENCHES["bench"].truth, prbs(7, amplitude=1.0, hold=3, axes=4)
    expected, free = (simulate(own, i_e, seed=None, **truth) for own in (rig, RIG.replace(speed=300.0)))
    values = {f"{kind}.{axis}": v for kind in ("K_i", "K_s") for axis, v in zip(rig.axes, truth[kind], strict=True)}
    found = Model(rig).with_values({**values, "tau_e": truth["tau_e"]}).simulate(i_e)
    for signal in ("y", "i_c"):
        ours, theirs, without = (getattr(own, signal) for own in (found, expected, free))
        assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())
        assert np.abs(theirs - without).max() > 1e-3 * np.abs(theirs).max()


# The rig file ---------------------------------------------------------------------------------------------------------


def test_everything_comes_back_from_a_file(tmp_path):
    rig = on_the_cones(0.0)
    rig.save(tmp_path / "rig.toml")
    again = Rig.load(tmp_path / "rig.toml")
    assert again == rig
    assert again.rotor.support[1].damping == 90.0
    assert again.rotor.section[0].outer_diameter_end == 0.055
    assert again.rotor.mass_damping == 2.5


WRONG = {
    "negative mass damping": {"mass_damping": -1.0},
    "support off the shaft": {"support": [{"position": 1.2, "stiffness": 1e5}]},
    "support in millimetres": {"support": [{"position": 430.0, "stiffness": 1e5}]},
    "support without a place": {"support": [{"stiffness": 1e5}]},
    "negative damping": {"support": [{"position": 0.2, "damping": -3.0}]},
    "misspelt": {"support": [{"position": 0.2, "stifness": 1e5}]},
    "bore wider than the thin end": {
        "section": [{"length": 0.5, "outer_diameter": 0.05, "outer_diameter_end": 0.02, "inner_diameter": 0.03}]
    },
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name, golden):
    given = {"material": STEEL, "section": [{"length": 0.86, "outer_diameter": 0.06}]}
    with golden.raises(RigError):
        FiniteElementRotor(**given | WRONG[name])
