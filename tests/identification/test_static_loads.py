"""Static loading against a hand calculation of the bearing reactions, its intervals, the campaign; what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid.errors import IdentificationError, RecordError, RigError
from ambid.identification import static_load
from ambid.record import StaticLoading
from ambid.rig import (
    Bearing,
    FiniteElementRotor,
    Material,
    ModalRotor,
    PidController,
    PointMassRotor,
    Rig,
    Section,
    Support,
)
from places import BENCH as BENCH_FILE
from places import SHARED
from reference.static_loads import CROSS, reactions
from tiers import first_fast
from validated import relative

BENCH = Rig.load(BENCH_FILE)
RIGID = BENCH.replace(rotor=BENCH.rotor.model_copy(update={"flexible_modes": 0, "bending_frequencies_hz": None}))
TRUE = np.array([217.0, 225.0, 278.0, 285.0])
CAMPAIGN = SHARED / "campaign"


def bearing(name="A", position=0.2, sensor_position=0.14, tilt=45.0, **changes):
    given = {"bias_current": 6.0, "air_gap": 5e-4, "force_current": 200.0, "force_displacement": 2.4e6}
    return Bearing(name=name, position=position, sensor_position=sensor_position, tilt=tilt, **given | changes)


def loaded(rig=RIGID, force=CROSS, z=0.43, noise=0.005, offset=0.0, gain=1.0, seed=0, cube=0.0, name="static"):
    """One loading on K_i = TRUE; `gain` is that of the load cell, `cube` [1/N^2] how the current grows with load."""
    z = np.broadcast_to(z, len(force)).astype(float)
    f = reactions(rig, gain * force, z)
    noise = noise * np.random.default_rng(seed).standard_normal(f.shape)
    return StaticLoading(name, rig.axes, z, force, f * (1 + cube * f**2) / TRUE + offset + noise)


def values(estimate):
    return np.array([k_i.value for k_i in estimate.parameters.values()])


def test_exact_data_give_exact_values(validated):
    estimate = static_load(RIGID, loaded(noise=0.0))
    assert list(estimate.parameters) == [f"K_i.{axis}" for axis in BENCH.axes]
    validated(
        "K_i by static loading without noise: relative error",
        "reactions of two bearings by hand",
        relative(values(estimate), TRUE),
        1e-12,
    )
    assert estimate.residual_newton < 1e-9
    assert_allclose(estimate.magnet_forces, reactions(RIGID, CROSS, np.full(len(CROSS), 0.43)), atol=1e-9)
    assert [k_i.unit for k_i in estimate.parameters.values()] == ["N/A"] * 4


@pytest.mark.parametrize(("tilt_a", "tilt_b"), [(0, 0), (30, 30), (45, 30), (-60, 200)])
def test_tilts_places_offsets_and_the_order_of_axes_do_not_matter(tilt_a, tilt_b):
    a, b = RIGID.bearings
    rig = RIGID.replace(bearings=(bearing(tilt=tilt_a), bearing("B", 0.66, 0.72, tilt_b)))
    gravity = reactions(rig, np.array([[0.0, -450.0]]), np.array([0.4])) / TRUE
    z = np.tile([0.2, 0.6, 0.1, 0.8], 13)
    one = loaded(rig, z=z, noise=0.0, offset=gravity)
    other = loaded(rig, noise=0.0, offset=np.array([0.1, -0.2, 0.3, 0.0]))
    back = StaticLoading("back", other.axes[::-1], other.z, other.force, other.i_c[:, ::-1])
    assert_allclose(values(static_load(rig, [one, back])), TRUE, rtol=1e-12)


def coverage(loadings_of_seed, seeds):
    """Share of the seeds, for each axis, whose interval holds the truth; and the ratio of std_error to the scatter."""
    found = [list(static_load(RIGID, loadings_of_seed(seed)).parameters.values()) for seed in range(seeds)]
    low, high = np.array([[k_i.ci95 for k_i in row] for row in found]).transpose(2, 0, 1)
    value, error = np.array([[(k_i.value, k_i.std_error) for k_i in row] for row in found]).transpose(2, 0, 1)
    ratio = np.sqrt(np.mean(error**2, axis=0)) / value.std(axis=0)
    assert_allclose(value.mean(axis=0), TRUE, rtol=1e-3)
    return np.mean((low < TRUE) & (high > TRUE)), ratio


@pytest.mark.parametrize(("noise", "seeds"), first_fast([(0.1, 150), (0.1, 500), (0.005, 500)]))
def test_intervals_of_one_loading(noise, seeds, validated):
    share, ratio = coverage(lambda seed: loaded(noise=noise, seed=seed), seeds)
    validated(
        "95 % intervals of K_i by static loading, 150 and 500 seeds: deviation of their coverage from 0.95",
        "truth of the reactions by hand",
        share - 0.95,
        0.02 * np.sqrt(500 / seeds),
    )
    assert_allclose(ratio, 1.0, atol=0.1)


@pytest.mark.slow
def test_intervals_where_the_noise_grows_with_the_load():
    growing = 0.002 + 0.01 * np.abs(CROSS).max(axis=1, keepdims=True) / 1500
    share, _ = coverage(lambda seed: loaded(noise=growing, seed=seed), 500)
    assert 0.93 < share < 0.97


@pytest.mark.parametrize("seeds", first_fast([150, 500]))
def test_intervals_of_loadings_whose_load_cell_differs(seeds):
    """Steps alone would say five times less: the cell is off by 0.5 % from loading to loading, on all axes at once."""
    small = CROSS[::4]

    def five(seed):
        gains = 1 + 0.005 * np.random.default_rng(10_000 + seed).standard_normal(5)
        return [loaded(force=small, gain=gain, seed=1000 * k + seed) for k, gain in enumerate(gains)]

    share, ratio = coverage(five, seeds)
    assert abs(share - 0.95) < 0.03 * np.sqrt(500 / seeds)  # the axes share their error, so that seeds show less
    assert_allclose(ratio, 1.0, atol=0.15)


def test_residual_in_newtons():
    estimate = static_load(RIGID, [loaded(seed=seed, noise=0.01) for seed in range(20)])
    assert_allclose(list(estimate.residual_newton_by_axis.values()), 0.01 * TRUE, rtol=0.06)
    assert_allclose(estimate.residual_newton, 0.01 * np.sqrt(np.mean(TRUE**2)), rtol=0.04)
    assert estimate.residuals.shape == (20 * len(CROSS), 4)


def found(estimate, code):
    """Its findings of one kind."""
    return [own for own in estimate.findings if own.code == code]


def test_saturation_is_seen():
    straight = [loaded(seed=seed) for seed in range(3)]
    assert not any(own.where.axis for own in static_load(RIGID, straight).findings)
    bent = [loaded(seed=seed, cube=0.02 / 533.0**2) for seed in range(3)]
    falls = found(static_load(RIGID, bent), "force_current_falls")
    assert [own.where.axis for own in falls] == list(RIGID.axes)
    assert falls[0].values["change"] == pytest.approx(0.02 / 1.02, abs=0.003)  # at the largest load
    assert np.all(values(static_load(RIGID, bent)) < TRUE)
    assert found(static_load(RIGID, loaded(cube=-0.1 / 533.0**2)), "force_current_rises")


def test_nonlinearity_is_not_seen_where_there_is_none():
    estimates = [static_load(RIGID, loaded(seed=seed)) for seed in range(200)]
    seen = [own for each in estimates for way in ("falls", "rises") for own in found(each, f"force_current_{way}")]
    assert len(seen) <= 2  # at 1e-3 over all axes


def test_too_few_levels_to_test_the_dependence_on_load():
    force = np.repeat([[0.0, 0.0], [900.0, 300.0], [-300.0, 900.0]], 4, axis=0)
    assert len(found(static_load(RIGID, loaded(force=force)), "too_few_loads")) == 4


def uniform_shaft(modes):
    """Slender shaft, 0.86 m, sensors 60 mm outboard of magnets 0.46 m apart."""
    shaft = FiniteElementRotor(
        material=Material(density=7850.0, youngs_modulus=2.06e11, poisson_ratio=0.3),
        section=[Section(length=0.86, outer_diameter=0.03)],
        flexible_modes=modes,
    )
    return BENCH.replace(rotor=shaft, bearings=(bearing(), bearing("B", 0.66, 0.72)))


def test_deflection_between_sensors_and_magnets():
    """A shaft on two supports loaded in the middle slopes by F L^2 / (16 E I) at its ends, which stay straight."""
    rig = uniform_shaft(8)
    loading = loaded(rig, force=CROSS / 10, noise=0.0)
    s_per_load = 0.06 * 0.46**2 / (16 * 2.06e11 * np.pi * 0.03**4 / 64)
    more = 2.4e6 * s_per_load / 0.5  # K_s s over the half of the load that the magnet carries
    corrected, classic = static_load(rig, loading, deflection=True), static_load(rig, loading)
    assert_allclose(values(classic), TRUE, rtol=1e-12)
    assert_allclose(values(corrected) / TRUE - 1.0, more, rtol=0.03)
    for estimate, code in ((classic, "deflection_left_out"), (corrected, "deflection_included")):
        (bent,) = found(estimate, code)
        assert_allclose(bent.values["most"], (values(corrected) / TRUE).max() - 1.0, rtol=0.02)


def test_by_flux_too_the_bent_rotor_is_taken_off():
    """Flux has the whole force; the current has what is left of it beside K_s s, s by the slope of the shaft's ends."""
    shaft = uniform_shaft(8)
    poles = [own.model_copy(update={"pole_area": 5e-4, "bias_flux": (0.5, 0.5)}) for own in shaft.bearings]
    rig, straight = shaft.replace(bearings=poles, tolerance={"exact": True}), loaded(shaft, CROSS / 10, noise=0.0)
    more = 2.4e6 * 0.06 * 0.46**2 / (16 * 2.06e11 * np.pi * 0.03**4 / 64) / 0.5
    flux = straight.i_c * TRUE * 4e-7 * np.pi / (2.0 * 5e-4 * 0.5)
    bent = replace(straight, i_c=(1.0 + more) * straight.i_c, b=flux)
    for deflection, expected in ((True, TRUE), (False, TRUE / (1.0 + more))):
        estimate = static_load(rig, bent, deflection=deflection)
        by_flux = [k_i.value for k_i in estimate.parameters_by_flux.values()]
        assert_allclose(by_flux, expected, rtol=0.03 * more)
        assert_allclose(values(estimate), by_flux, rtol=1e-9)


def test_a_support_carries_its_part_of_the_load_where_the_rotor_bends():
    """In the middle u = c F, c = (L^3/48 + a L^2/16)/EI, sensors a beyond the magnets: k takes k c/(1 + k c) of F."""
    rig, k = uniform_shaft(8), 2e5
    held = rig.replace(rotor=rig.rotor.model_copy(update={"support": (Support(position=0.43, stiffness=k),)}))
    loading = loaded(held, force=CROSS / 10, noise=0.0)
    free, supported, classic = (
        static_load(own, loading, deflection=on) for own, on in ((rig, 1), (held, 1), (held, 0))
    )
    c = (0.46**3 / 48 + 0.06 * 0.46**2 / 16) / (2.06e11 * np.pi * 0.03**4 / 64)
    assert_allclose(values(supported) / values(free), 1.0 / (1.0 + k * c), rtol=2e-3)
    assert_allclose(values(classic), TRUE, rtol=1e-12)
    assert found(supported, "deflection_included")[0].values["supports"] == 1


def test_a_support_of_a_rigid_rotor_carries_nothing():
    held = RIGID.rotor.model_copy(update={"support": (Support(position=0.3, stiffness=1e6),)})
    estimate = static_load(RIGID.replace(rotor=held), loaded(), deflection=True)
    assert_allclose(values(estimate), values(static_load(RIGID, loaded())))
    assert not found(estimate, "deflection_included")


def test_a_rigid_rotor_has_no_deflection():
    assert_allclose(values(static_load(RIGID, loaded(), deflection=True)), values(static_load(RIGID, loaded())))


def test_deflection_of_a_rotor_that_is_not_known_at_the_load(golden):
    shapes = [[0.15] * 4, [-0.2, -0.17, 0.17, 0.2], [0.1, -0.05, -0.05, 0.1]]
    rotor = ModalRotor(
        frequencies_hz=[0, 0, 500], damping=[0, 0, 0.01], positions=[0.14, 0.2, 0.66, 0.72], shapes=shapes
    )
    rig = BENCH.replace(rotor=rotor)
    assert found(static_load(rig, loaded(rig)), "deflection_unknown")
    with golden.raises(RigError):
        static_load(rig, loaded(rig), deflection=True)


def single_axis(**changes):
    controller = PidController(
        implementation="analog",
        proportional=1e4,
        integral=1e4,
        derivative=30.0,
        derivative_time_constant=1e-4,
    )
    given = {"rotor": PointMassRotor(mass=2.0), "bearings": (bearing(tilt=90.0, axes=("zeta",)),)}
    return BENCH.replace(**given | {"controller": controller} | changes)


def test_single_axis_has_one_equation():
    rig = single_axis()
    force = np.stack([np.full(11, 3.0), np.linspace(-50, 50, 11)], axis=1)
    loading = StaticLoading("s", rig.axes, np.zeros(11), force, -force[:, 1:] / 80.0 + 0.2)
    estimate = static_load(rig, loading, deflection=True)
    assert_allclose(values(estimate), 80.0, rtol=1e-12)
    assert estimate.residuals.shape == (11, 1)


def test_axes_in_one_plane():
    rig = RIGID.replace(bearings=(bearing(axes=("zeta",)), bearing("B", 0.66, 0.72, axes=("zeta",))))
    full = loaded(noise=0.0)
    loading = StaticLoading("s", rig.axes, full.z, full.force, full.i_c[:, [0, 2]])
    assert_allclose(values(static_load(rig, loading)), TRUE[[0, 2]], rtol=1e-12)


@pytest.mark.parametrize(
    "bearings",
    [
        (bearing(), bearing("B", 0.43, 0.43), bearing("C", 0.66, 0.72)),
        (bearing(), bearing("B", 0.2, 0.72)),
        (bearing(),),
    ],
    ids=["three bearings", "two at one place", "one bearing"],
)
def test_statics_that_do_not_determine_the_forces(bearings, golden):
    rig = RIGID.replace(bearings=bearings)
    loading = StaticLoading("s", rig.axes, np.full(52, 0.43), CROSS, np.ones((52, len(rig.axes))))
    with golden.raises(IdentificationError):
        static_load(rig, loading)


def test_loads_along_one_axis_only(golden):
    jitter = np.random.default_rng(1).normal(0, 2.0, len(CROSS))
    force = np.stack([CROSS[:, 0] + CROSS[:, 1], jitter], axis=1)
    rig = RIGID.replace(bearings=(bearing(tilt=0.0), bearing("B", 0.66, 0.72, 0.0)))
    with golden.raises(IdentificationError):
        static_load(rig, loaded(rig, force=force))
    with golden.raises(IdentificationError):
        static_load(RIGID, loaded(z=0.2))


def test_loads_that_are_too_small_or_rest_on_one_step(golden):
    with golden.raises(IdentificationError):
        static_load(RIGID, loaded(force=CROSS / 1000))
    once = np.zeros((9, 2))
    once[4] = 1000.0, 300.0
    with golden.raises(IdentificationError):
        static_load(RIGID, loaded(force=once))


def test_other_refusals(golden):
    with golden.raises(IdentificationError):
        static_load(RIGID, [])
    with golden.raises(IdentificationError):
        static_load(RIGID, loaded(force=CROSS[:2]))
    with pytest.raises(IdentificationError, match=r"K_i.A_zeta \(0 N rms\), .*K_i.B_eta"):
        static_load(RIGID, loaded(force=0.0 * CROSS))
    good = loaded()
    with golden.raises(IdentificationError):
        static_load(RIGID, StaticLoading("s", good.axes, good.z, -good.force, good.i_c))
    with pytest.raises(RecordError, match=r"missing: B_zeta"):
        static_load(RIGID, StaticLoading("s", ("A_zeta", "A_eta", "C_zeta", "B_eta"), good.z, good.force, good.i_c))


def test_result_as_json_and_as_text():
    estimate = static_load(RIGID, [loaded(name=f"static_{k}", seed=k) for k in range(3)])
    data = json.loads(json.dumps(estimate.to_json()))
    assert set(data["parameters"]["K_i.A_zeta"]) == {
        *("value", "std_error", "ci95", "unit"),
        "std_error_statistical",
    }
    assert (data["loadings"], data["steps"]) == (["static_0", "static_1", "static_2"], 156)
    assert data["residual_newton"] == estimate.residual_newton
    assert "f = K_i i + K_s s" in str(estimate)
    assert all(name in str(estimate) for name in estimate.parameters)


@pytest.mark.skipif(not CAMPAIGN.is_dir(), reason="the campaign's files are not here")
@pytest.mark.parametrize(
    ("bias", "low", "high"), [("6A", -0.008, 0.0), ("8A", -0.013, -0.004), ("10A", -0.017, -0.009)]
)
def test_campaign(bias, low, high, validated):
    """Static K_i lies below the small-signal one by 0.44..0.53 % at 6 A, 0.73..0.99 % at 8 A, 1.24..1.34 % at 10 A."""
    rig = Rig.load(CAMPAIGN / bias / "rig.toml")
    estimate = static_load(rig, [StaticLoading.load(p, rig) for p in sorted((CAMPAIGN / bias).glob("static_*.csv"))])
    small_signal = np.array(json.loads((CAMPAIGN / "answers.json").read_text())[bias]["K_i"])
    excess = values(estimate) / small_signal - 1.0
    middle = 0.5 * (low + high)
    validated(
        "Static K_i below the small-signal one, at 6, 8 and 10 A: deviation from the middle of the range",
        "reluctance law with saturating iron that has K_s of Table 2 of the paper, static loads up to 1500 N",
        excess - middle,
        high - middle,
    )
    assert len(found(estimate, "force_current_falls")) == 4
    assert 1.0 < estimate.residual_newton < 4.0


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e-6], ids=["kN", "mN", "MN"])
def test_forces_in_other_units_are_refused(factor, golden):
    one = loaded()
    with golden.raises(IdentificationError):
        static_load(RIGID, StaticLoading(one.name, one.axes, one.z, factor * one.force, one.i_c))


def test_exchanged_bearings_are_found():
    apart = np.tile([0.25, 0.6], 26)
    for z, code in ((0.43, "bearings_exchanged_by_nominal"), (apart, "bearings_exchanged")):
        one = loaded(z=z)
        swapped = StaticLoading(one.name, one.axes, one.z, one.force, one.i_c[:, [2, 3, 0, 1]])
        (shown,) = found(static_load(RIGID, swapped), code)
        assert (shown.values["bearings"], shown.values["others"]) == (["A", "B"], ["B", "A"])
        assert not any(own.code.startswith("bearings_exchanged") for own in static_load(RIGID, one).findings)


def test_a_value_far_from_the_nominal_one_is_found():
    a, b = RIGID.bearings
    rig = RIGID.replace(bearings=(a.model_copy(update={"force_current": (100.0, 200.0)}), b))
    (far,) = found(static_load(rig, loaded()), "force_current_far_from_nominal")
    assert (far.where.axis, far.values["nominal"]) == ("A_zeta", 100.0)
    assert_allclose([far.values["value"], far.values["factor"]], [216.9, 2.169], rtol=1e-3)
