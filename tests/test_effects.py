"""Every effect of the catalogue against an independent simulation of the same physics, without noise."""

import numpy as np
import pytest

import ambid
from ambid.effects import CATALOGUE, find
from ambid.effects.actuator import half_order
from ambid.effects.amplifier import pade
from ambid.errors import ModelError
from ambid.rig import Rig
from hidden.bench import simulate

TRUTH = {
    "K_i": np.array([205.0, 212.0, 262.0, 268.0]),
    "K_s": np.array([2.39e6, 2.49e6, 3.13e6, 3.19e6]),
    "tau_e": 2.5e-4,
}
# name: hidden physics, our parameters, agreement relative to the peak
AGREE = {
    "bending_mode_shift": (
        {"frequency_factor": 1.01},
        {"squared_frequency_1": 1.01**2 - 1.0, "damping_1": 0.01 * 0.004},
        1e-9,
    ),
    "rotor_inertia_error": ({"inertia_factor": 1.05}, {"inertia": 0.05}, 1e-9),
    "seal_forces": (
        {"z": 0.43, "direct": 8e5, "cross": 6e5, "damping": 300.0},
        {"direct_stiffness": 8e5, "cross_stiffness": 6e5, "damping": 300.0},
        1e-9,
    ),
    "coupling_stiffness": ({"stiffness": 2e5, "damping": 50.0}, {"stiffness": 2e5, "damping": 50.0}, 1e-9),
    "foundation_resonance": (
        {"frequency_hz": 130.0, "damping": 0.04, "mass_kg": 400.0},
        {"frequency_hz": 130.0, "damping": 0.04, "inverse_mass": 1.0 / 400.0},
        1e-9,
    ),
    "eddy_currents": ({"tau": 1e-6}, {"time_constant": 1e-6}, 2e-3),
    "axis_cross_coupling": ({"fraction": 0.05}, {"share_A": 0.05, "share_B": 0.05}, 1e-9),
    "amplifier_bandwidth": ({"frequency_hz": 1100.0, "damping": 0.45}, {"frequency_hz": 1100.0, "damping": 0.45}, 1e-9),
    "loop_delay": ({"seconds": 5e-5}, {"delay": 5e-5}, 5e-3),
    "sensor_lag": ({"tau": 3e-5}, {"time_constant": 3e-5}, 1e-9),
    "sensor_gain_error": ({"gain": [1.03, 1.02, 0.97, 0.98]}, {"zeta": 0.03, "eta": 0.02}, 1e-9),
    "sensor_misalignment": ({"degrees": [0.2, -0.1]}, {"angle_A": 0.2, "angle_B": -0.1}, 2e-4),
    "sensor_position_error": ({"dz": [2e-3, -1e-3]}, {"offset_A": 2e-3, "offset_B": -1e-3}, 1e-4),
    "sampling_skew": ({"seconds": 1e-5}, {"current_late": 1e-5}, 1e-3),
    "back_emf": ({"coefficient": 5.0}, {"current_per_velocity": 5.0}, 1e-9),
}


@pytest.fixture(scope="module")
def rig(request):
    return Rig.load(request.config.rootpath / "tests" / "data" / "bench_rig.toml")


@pytest.fixture(scope="module")
def i_e():
    return ambid.prbs(8, amplitude=1.0, hold=3, axes=4, periods=2)


def at_truth(rig: Rig) -> ambid.Model:
    values = {f"{kind}.{axis}": v for kind in ("K_i", "K_s") for axis, v in zip(rig.axes, TRUTH[kind], strict=True)}
    return ambid.Model(rig).with_values({**values, "tau_e": TRUTH["tau_e"]})


def largest_error(found: ambid.Record, expected: ambid.Record) -> float:
    """Of y and i_c, relative to the peak of each signal."""
    pairs = ((found.y, expected.y), (found.i_c, expected.i_c))
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs)


@pytest.mark.parametrize("name", AGREE)
def test_effect_is_the_physics_that_it_says(rig, i_e, name):
    hidden, values, tolerance = AGREE[name]
    if name == "sensor_misalignment":
        values = {key: np.deg2rad(value) for key, value in values.items()}
    truth = simulate(rig, i_e, {name: hidden}, seed=None, **TRUTH)
    absent = {p.name: values.get(p.name, 0.0) for p in find(name).parameters(rig)}
    base = at_truth(rig)
    model = base.add(name, absent)
    without, with_it = largest_error(base.simulate(i_e), truth), largest_error(model.simulate(i_e), truth)
    assert with_it < tolerance
    assert without > 5.0 * with_it, "the effect must show"


def test_omitted_bending_modes_come_back(rig, i_e):
    rigid = rig.replace(rotor=rig.rotor.model_copy(update={"flexible_modes": 0}))
    truth = simulate(rigid, i_e, {"rotor_bending_mode": {"count": 2}}, seed=None, **TRUTH)
    model = at_truth(rigid).add("rotor_bending_mode")
    assert largest_error(model.simulate(i_e), truth) < 1e-6
    assert largest_error(at_truth(rigid).simulate(i_e), truth) > 1e-2


def test_gyroscopic_factor(rig, i_e):
    turning = rig.replace(speed=1000.0)
    truth = simulate(turning, i_e, {"gyroscopic_coupling": {"factor": 1.3}}, seed=None, **TRUTH)
    model = at_truth(turning).add("gyroscopic_coupling", {"factor": 0.3})
    assert largest_error(model.simulate(i_e), truth) < 1e-8
    assert find("gyroscopic_coupling").parameters(rig) == [], "no gyroscopic moments at rest"


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_sensitivities_of_effects(rig, i_e, effect):
    """Against central differences of the response, every parameter of every effect."""
    rig = rig.replace(speed=800.0) if effect.name == "gyroscopic_coupling" else rig
    parameters = effect.parameters(rig)
    assert parameters, "every effect applies to this rig"
    model = at_truth(rig).add(effect)
    u = i_e[:300]
    for k, p in enumerate(parameters, start=len(model.names) - len(parameters)):
        _, jacobian = model.loop.sensitivity(model.theta, u, [k])
        step = 1e-4 * p.probe
        high, low = model.theta, model.theta
        high[k] += step
        low[k] -= step
        difference = (model.loop.simulate(high, u) - model.loop.simulate(low, u)) / (2.0 * step)
        peak = np.abs(difference).max(axis=0)
        size = np.abs(model.loop.simulate(model.theta, u)).max(axis=0) / p.probe
        assert (peak > 1e-7 * size).any(), f"{effect.name}.{p.name} does nothing"
        seen = peak > 1e-5 * size
        error = np.abs(jacobian[:, :, 0] - difference).max(axis=0)
        assert (error[seen] < 1e-3 * peak[seen]).all(), p.name


def test_descriptions_are_complete():
    names = [effect.name for effect in CATALOGUE]
    assert len(set(names)) == len(names)
    for effect in CATALOGUE:
        assert all(len(text) > 15 for text in (effect.physics, effect.signature, effect.source)), effect.name


def test_pade_is_a_delay():
    a, b, c = pade(6)
    s = 1j * np.linspace(0.01, 1.0, 50)
    response = np.array([c @ np.linalg.solve(x * np.eye(6) - a, b) for x in s])
    np.testing.assert_allclose(response, np.exp(-s) - 1.0, atol=1e-12)


def test_half_order_lag():
    ratios, shares = half_order()
    s = 1j * np.logspace(-4, 1, 60)
    response = (shares / (1.0 + s[:, None] * ratios)).sum(axis=1)
    np.testing.assert_allclose(response, 1.0 / (1.0 + np.sqrt(s)), atol=5e-3)


def test_mistakes_are_named(rig):
    model = ambid.Model(rig)
    with pytest.raises(ModelError, match=r"loop_lag: no such effect; the catalogue has .*loop_delay"):
        model.add("loop_lag")
    with pytest.raises(ModelError, match=r"loop_delay: no parameter tau; it has delay"):
        model.add("loop_delay", {"tau": 1e-5})
    with pytest.raises(ModelError, match=r"loop_delay is in the model already"):
        model.add("loop_delay").add("loop_delay")
    with pytest.raises(ModelError, match=r"gyroscopic_coupling makes no sense on this rig"):
        model.add("gyroscopic_coupling")
    with pytest.raises(ModelError, match=r"seal_forces is not in the model; it has none"):
        model.without("seal_forces")


def test_effects_survive_saving(tmp_path, rig, i_e):
    seal = next(variant for variant in find("seal_forces").variants(rig) if variant.settings() == {"z": 0.26})
    model = at_truth(rig).add(seal).add("loop_delay")
    model.save(tmp_path / "model.json")
    again = ambid.Model.load(tmp_path / "model.json")
    assert again.names == model.names
    np.testing.assert_array_equal(again.simulate(i_e).y, model.simulate(i_e).y)
    assert again.without("loop_delay").without("seal_forces").names == ambid.Model(rig).names
