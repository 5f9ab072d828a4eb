"""An error of a value in the rig file does to the loop what another rig file would, by an independent simulation."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, prbs
from ambid.effects import CATALOGUE, find
from ambid.effects.known import KNOWN
from ambid.errors import ModelError, UnstableLoopError
from ambid.rig import Rig
from hidden.bench import simulate
from hidden.families import BENCHES
from places import BENCH, LEVITATOR

TRUTH = BENCHES["bench"].truth
AGREE = 0.01
"""Of the change: the errors are of first order, or their squares are as small."""


def of_bearings(rig: Rig, key: str, off: list[float]) -> Rig:
    """The rig with a key of every bearing moved."""
    moved = [b.model_copy(update={key: getattr(b, key) + d}) for b, d in zip(rig.bearings, off, strict=True)]
    return rig.replace(bearings=tuple(moved))


def of_table(rig: Rig, table: str, **factors: float) -> Rig:
    """The rig with keys of a table times factors."""
    own = getattr(rig, table)
    scaled = {
        key: tuple(factor * v for v in value) if isinstance(value := getattr(own, key), tuple) else factor * value
        for key, factor in factors.items()
    }
    return rig.replace(**{table: own.model_copy(update=scaled)})


MACHINES = {
    "position": (
        lambda rig: of_bearings(rig, "position", [2e-4, -1e-4]),
        {"position.A": 2e-4, "position.B": -1e-4},
    ),
    "sensor_position": (
        lambda rig: of_bearings(rig, "sensor_position", [2e-4, -1e-4]),
        {"sensor_position.A": 2e-4, "sensor_position.B": -1e-4},
    ),
    "bending_frequency": (
        lambda rig: of_table(rig, "rotor", bending_frequencies_hz=1.0002),
        {"bending_frequency.1": 2e-4, "bending_frequency.2": 2e-4},
    ),
    "modal_damping": (
        lambda rig: of_table(rig, "rotor", modal_damping=1.02),
        {"modal_damping.1": 0.02, "modal_damping.2": 0.02},
    ),
    "amplifier_time_constant": (
        lambda rig: of_table(rig, "amplifier", time_constant=1.05),
        {f"amplifier_time_constant.{axis}": 0.05 for axis in ("A_zeta", "A_eta", "B_zeta", "B_eta")},
    ),
    "controller_gain": (
        lambda rig: of_table(rig, "controller", proportional=1.01, derivative=0.98),
        {"controller_gain.proportional": 0.01, "controller_gain.derivative": -0.02},
    ),
}


@pytest.fixture(scope="module")
def analog() -> Rig:
    """The bench as an analog machine of which nothing is exact."""
    rig = Rig.load(BENCH)
    controller = rig.controller.model_copy(update={"implementation": "analog", "delay_samples": 0.0})
    return rig.replace(controller=controller, tolerance={})


@pytest.fixture(scope="module")
def i_e():
    return prbs(7, amplitude=0.1, hold=2, axes=4, periods=2)


@pytest.fixture(scope="module")
def nominal(analog, i_e):
    """Response of the machine that is as its rig file says."""
    return simulate(analog, i_e, seed=None, **TRUTH)


def known(rig: Rig, values: dict[str, float]) -> Model:
    """The bench's true model, with errors of the rig file."""
    own = {f"{name}.{axis}": v for name in ("K_i", "K_s") for axis, v in zip(rig.axes, TRUTH[name], strict=True)}
    return Model(rig).with_tolerances().with_values({**own, "tau_e": float(np.mean(TRUTH["tau_e"])), **values})


@pytest.mark.parametrize("key", MACHINES)
def test_an_error_is_what_another_rig_file_says(analog, i_e, nominal, key):
    other, values = MACHINES[key]
    truth = simulate(other(analog), i_e, seed=None, **TRUTH)
    model = known(analog, values)
    found = model.response(truth)
    change = truth.outputs - nominal.outputs
    assert np.abs(found - truth.outputs).max(axis=0) == pytest.approx(0.0, abs=AGREE * np.abs(change).max())
    assert np.abs(change).max() > 0.0


def test_gains_of_readings_and_excitation_scale_what_is_read(analog, i_e):
    model = known(analog, {})
    before = model.simulate(i_e)
    read = model.with_values({"current_gain.A_zeta": 0.02}).simulate(i_e)
    np.testing.assert_allclose(read.i_c[:, 0], 1.02 * before.i_c[:, 0], rtol=1e-9)
    np.testing.assert_allclose(read.y, before.y, atol=1e-18)
    louder = model.with_values({"excitation_gain": 0.005}).simulate(i_e)
    np.testing.assert_allclose(louder.outputs, 1.005 * before.outputs, atol=1e-9 * np.abs(before.outputs).max())
    # a sensor that reads too much acts like a controller that is as much too strong
    every = {f"sensor_gain.{axis}": 0.02 for axis in analog.axes}
    gains = dict.fromkeys((f"controller_gain.{gain}" for gain in analog.controller.gains), 0.02)
    scaled, stronger = model.with_values(every).simulate(i_e), model.with_values(gains).simulate(i_e)
    np.testing.assert_allclose(scaled.y, 1.02 * stronger.y, atol=1e-9 * np.abs(before.y).max())


def test_a_mass_on_one_axis_is_heavier():
    rig = Rig.load(LEVITATOR).replace(tolerance={})
    i_e = prbs(7, amplitude=0.05, periods=2, axes=1)
    heavier = rig.replace(rotor=rig.rotor.model_copy(update={"mass": 1.01 * rig.rotor.mass}))
    found = Model(rig).with_tolerances().with_values({"mass": 0.01}).simulate(i_e)
    np.testing.assert_allclose(found.outputs, Model(heavier).simulate(i_e).outputs, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("effect", KNOWN, ids=lambda effect: effect.key)
def test_what_is_exact_has_no_error(effect):
    rig = Rig.load(BENCH)
    assert not effect.parameters(rig)
    assert not effect.parameters(rig.replace(tolerance={"exact": True}))
    assert not effect.parameters(rig.replace(tolerance={effect.key: 0.0}))


def test_digital_controllers_have_no_error_of_gain_nor_of_what_they_add():
    rig = Rig.load(BENCH)
    digital = rig.replace(
        controller=rig.controller.model_copy(update={"implementation": "digital"}), tolerance={"mass": 0.01}
    )
    names = {p.name for p in Model(digital).with_tolerances().tolerances}
    assert not {name for name in names if name.startswith(("controller_gain", "excitation_gain"))}
    assert "mass" in names


@pytest.mark.parametrize("effect", [own.name for own in CATALOGUE])
@pytest.mark.parametrize("path", [BENCH, LEVITATOR], ids=["four axes", "one axis"])
def test_every_effect_acts_beside_errors_as_without_them(path, effect):
    """Errors of nearly nothing change nearly nothing, and no loop is closed at once by what they are rounded by."""
    rig = Rig.load(path).replace(tolerance={}, speed=100.0)
    try:
        alone = Model(rig).add(effect)
        right = alone.simulate(prbs(6, amplitude=0.01, axes=len(rig.axes)))
    except (ModelError, UnstableLoopError) as error:
        pytest.skip(str(error))
    known = Model(rig).with_tolerances()
    off = known.with_values({p.name: 1e-9 * p.prior for p in known.tolerances}).add(effect)
    found = off.simulate(prbs(6, amplitude=0.01, axes=len(rig.axes)))
    np.testing.assert_allclose(found.y, right.y, atol=1e-6 * np.abs(right.y).max())
    np.testing.assert_allclose(found.i_c, right.i_c, atol=1e-6 * np.abs(right.i_c).max())


@pytest.mark.parametrize(
    ("kind", "hidden", "values"),
    [
        ("second order", {"frequency_hz": 1100.0, "damping": 0.7}, {"frequency_hz": 1.05 * 1100.0, "damping": 0.7}),
        ("other lag", {"time_constant": 3e-4}, {"time_constant": 3e-4 / 1.05}),
    ],
)
def test_an_amplifier_of_any_kind_is_slower_by_the_error_of_its_lag(analog, i_e, kind, hidden, values):
    """What takes the place of the rig file's amplifier has the errors of that: 5 % slower is a slower clock."""
    truth = simulate(analog, i_e, {"amplifier_bandwidth": hidden}, seed=None, **TRUTH)
    slower = {f"amplifier_time_constant.{axis}": 0.05 for axis in analog.axes}
    effect = replace(find("amplifier_bandwidth"), kind=kind)
    found = known(analog, slower).add(effect, values).simulate(i_e)
    np.testing.assert_allclose(found.outputs, truth.outputs, atol=1e-8 * np.abs(truth.outputs).max())
