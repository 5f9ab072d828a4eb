"""K_i by flux beside K_i by load: against reactions by hand, a magnet's closed form and the independent simulator."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid.errors import IdentificationError
from ambid.identification import static_load
from ambid.record import StaticLoading
from ambid.rig import Rig
from hidden.bench import simulate_all
from hidden.families import BENCHES
from places import BENCH as BENCH_FILE
from reference.static_loads import CROSS, reactions
from validated import relative

MU_0 = 4e-7 * np.pi
TRUE = np.array([217.0, 225.0, 278.0, 285.0])
AREA = 5e-4
NAMES = ("pole_area", "bias_flux")


def instrumented(rig, K_i, modes=0) -> Rig:
    """Poles of 5 cm^2 whose bias flux is that of the true K_i = 4 A B_0^2/(mu_0 i_0)."""
    rotor = rig.rotor.model_copy(update={"flexible_modes": modes, "bending_frequencies_hz": None})
    flux = [float(np.sqrt(MU_0 * k_i * rig.bearings[0].bias_current / 4.0 / AREA)) for k_i in K_i]
    own = [
        bearing.model_copy(update={"pole_area": AREA, "bias_flux": tuple(flux[2 * k : 2 * k + 2])})
        for k, bearing in enumerate(rig.bearings)
    ]
    return rig.replace(rotor=rotor, bearings=own)


RIG = instrumented(Rig.load(BENCH_FILE), TRUE).replace(tolerance={"exact": True})
B_0 = np.array([b for bearing in RIG.bearings for b in bearing.bias_flux])


def loaded(cell=1.0, area=AREA, current=0.005, flux=2e-4, seed=0):
    """A load cell that shows `cell` times the force; b = 2 B_0 i/i_0 of poles whose force is 2 A B_0 b/mu_0."""
    random = np.random.default_rng(seed)
    z = np.full(len(CROSS), 0.43)
    f = reactions(RIG, CROSS, z)
    b = f * MU_0 / (2.0 * area * B_0)
    i_c = f / TRUE + current * random.standard_normal(f.shape)
    return StaticLoading("static", RIG.axes, z, cell * CROSS, i_c, b=b + flux * random.standard_normal(f.shape))


def values(parameters):
    return np.array([k_i.value for k_i in parameters.values()])


def codes(estimate):
    return [own.code for own in estimate.findings]


def test_both_are_exact_without_noise_and_a_load_cell_s_gain_is_in_one_alone():
    found = static_load(RIG, loaded(current=0.0, flux=0.0))
    assert_allclose(values(found.parameters_by_flux), TRUE, rtol=1e-12)
    assert_allclose(values(found.parameters), TRUE, rtol=1e-12)
    assert "force_by_flux_differs" not in codes(static_load(RIG, loaded()))
    loud = static_load(RIG, loaded(cell=1.04))
    assert_allclose(values(loud.parameters_by_flux), TRUE, rtol=5e-3)
    assert_allclose(values(loud.parameters), 1.04 * TRUE, rtol=5e-3)
    assert codes(loud).count("force_by_flux_differs") == 4
    assert list(loud.to_json()["parameters_by_flux"]) == [f"K_i.{axis}" for axis in RIG.axes]
    rows = str(loud).splitlines()
    assert all(any(f" {k_i.value:.6g} " in row for row in rows) for k_i in loud.parameters_by_flux.values())


def test_an_error_of_the_pole_area_is_one_of_the_flux_within_its_tolerance():
    wrong = loaded(area=1.04 * AREA)
    assert codes(static_load(RIG, wrong)).count("force_by_flux_differs") == 4
    known = static_load(RIG.replace(tolerance={"flux_gain": 0.05}), wrong)
    assert "force_by_flux_differs" not in codes(known)
    for name, k_i in known.parameters_by_flux.items():
        assert k_i.std_error == pytest.approx(0.05 * k_i.value, rel=0.01), name


def test_intervals_hold_the_truth_in_noise_of_both_channels():
    """Noise of b that would bias a regression on it by several standard deviations."""
    found = [static_load(RIG, loaded(flux=0.02, seed=seed)).parameters_by_flux for seed in range(100)]
    k_i = np.array([values(own) for own in found])
    ends = np.array([[p.ci95 for p in own.values()] for own in found])
    inside = (ends[..., 0] < TRUE) & (ends[..., 1] > TRUE)
    assert abs(inside.mean() - 0.95) < 0.04
    assert (np.abs(k_i.mean(axis=0) - TRUE) < 4.0 * k_i.std(axis=0) / 10.0).all()


LOADS = [
    (0.43, 1000.0 * x, 1000.0 * y) for x, y in ((0, 0), (1, 0), (0.5, 0.5), (0, 1), (-1, 0), (-0.5, -0.5), (0, -1))
]
"""z [m], F_x and F_y [N]."""
SAMPLES = 500
"""Of a reading, whose means are taken."""


def levitated(rig, noise, readings):
    """Readings under each load of the rotor that the independent simulator levitates, each of all loads."""
    b = [f"b.{axis}" for axis in rig.axes]
    rms = {"sensor_noise": 50e-9 * noise, "current_noise": 0.05 * noise, "further": dict.fromkeys(b, 0.02 * noise)}
    still = {"rig": rig, "i_e": np.zeros((readings * SAMPLES, len(b)))} | BENCHES["bench"].truth | rms
    records = simulate_all([still | {"load": load, "seed": seed} for seed, load in enumerate(LOADS)])
    z, *force = np.transpose(LOADS)
    flux = [np.column_stack([record.further[name] for name in b]) for record in records]
    i_c, flux = (
        np.array([column.reshape(readings, SAMPLES, len(b)).mean(axis=1) for column in columns])
        for columns in ([record.i_c for record in records], flux)
    )
    return [
        StaticLoading(f"reading {k}", rig.axes, z, np.transpose(force), i_c[:, k], b=flux[:, k])
        for k in range(readings)
    ]


@pytest.mark.parametrize("modes", [0, 2])
def test_intervals_by_load_and_by_flux_hold_the_truth_of_a_levitated_rotor(modes, validated):
    bench = BENCHES["bench"]
    rig = instrumented(bench.rig, bench.K_i, modes).replace(tolerance={"exact": True})
    stiffness = [{"force_displacement": bench.K_s[k : k + 2]} for k in (0, 2)]
    rig = rig.replace(bearings=[b.model_copy(update=k_s) for b, k_s in zip(rig.bearings, stiffness, strict=True)])
    silent = static_load(rig, levitated(rig, 0.0, 1), deflection=True)
    found = [static_load(rig, loading, deflection=True) for loading in levitated(rig, 1.0, 20)]
    both = [own for one in found for own in (one.parameters, one.parameters_by_flux)]
    ends = np.array([[k_i.ci95 for k_i in own.values()] for own in both])
    validated(
        "K_i by load and by flux of a levitated rotor under static loads, without noise: relative error",
        "truth of the independent simulator in C",
        [relative(values(own), bench.K_i) for own in (silent.parameters, silent.parameters_by_flux)],
        1e-9,
    )
    validated(
        "K_i by load and by flux of a levitated rotor under static loads: share of intervals with the truth, less 0.95",
        "truth of the independent simulator in C",
        np.mean((ends[..., 0] < bench.K_i) & (ends[..., 1] > bench.K_i)) - 0.95,
        0.06,
    )


def test_what_is_missing_is_named():
    no_gain = RIG.replace(bearings=[b.model_copy(update=dict.fromkeys(NAMES)) for b in RIG.bearings])
    assert codes(static_load(no_gain, loaded())).count("flux_gain_unknown") == 4
    half = RIG.replace(bearings=[b.model_copy(update={"bias_flux": None}) for b in RIG.bearings])
    assert codes(static_load(half, loaded())).count("flux_gain_by_nominal") == 4
    with pytest.raises(IdentificationError):
        static_load(RIG, [loaded(), replace(loaded(seed=1), b=None)])
    assert not static_load(RIG, replace(loaded(), b=None)).parameters_by_flux


def test_a_file_has_flux_densities(tmp_path):
    own = loaded()
    names = ["step", "z", "F_x", "F_y", *(f"i_c.{a}" for a in RIG.axes), *(f"b.{a}" for a in RIG.axes)]
    table = np.column_stack([np.arange(len(own.z)), own.z, own.force, own.i_c, own.b])
    path = tmp_path / "static_1.csv"
    np.savetxt(path, table, "%.17g", ",", header=",".join(names), comments="")
    read = StaticLoading.load(path, RIG)
    assert not read.findings
    assert_allclose(values(static_load(RIG, read).parameters_by_flux), values(static_load(RIG, own).parameters_by_flux))
