"""Dry friction where the catalogue has no name for it: none first, then its measured shape, then an own effect."""

import numpy as np
import pytest

import ambid
from ambid.diagnosis import measured_shape
from ambid.effects import CATALOGUE, Effect, EffectParameter, MeasuredShape
from ambid.errors import ModelError
from found import the
from hidden.one_axis import ONE_AXIS
from reference.friction_loop import FRICTION, K_I, KNEE, record

RIG = ONE_AXIS.rig
NAMELESS = tuple(effect for effect in CATALOGUE if effect.name != "coulomb_friction")
"""The catalogue without a name for it."""


class Friction(Effect):
    """What a person writes who has seen the shape."""

    name = "friction"
    physics = "dry friction holds the mass"
    signature = "odd; a step over the velocity"
    source = "the measured shape"

    def parameters(self, rig):
        return [EffectParameter("force", "N", 1.0)]

    def attach(self, plant):
        for axis in plant.axes:
            force = plant.table(lambda v: -np.tanh(v / KNEE), [plant[f"v.{axis}"]], [0.05], self.slot("force"))
            plant.inject(f"f.{axis}", force)


@pytest.fixture(scope="module")
def records():
    i_e = ambid.prbs(8, amplitude=1.0, hold=4, periods=4)
    return record(RIG, i_e, 1), record(RIG, 0.8 * i_e, 2)


@pytest.fixture(scope="module")
def found(records):
    return ambid.diagnose(RIG, records[0], validate=records[1:], catalogue=NAMELESS)


@pytest.fixture(scope="module")
def force(records):
    where = ambid.localise(ambid.identify(RIG, records[0]).comparison)
    return next(port for port in where.ports if port.name == "force")


@pytest.mark.slow
def test_a_shape_is_measured_round_by_round_without_an_identification_of_each(records):
    shape = measured_shape(ambid.identify(RIG, records[0]).comparison, "force", "v")
    slip = np.array([v for v in shape.at if 3.0 * KNEE < abs(v) < 0.015])
    values = np.interp(slip, shape.at, shape.values)
    assert values == pytest.approx(-FRICTION * np.sign(slip), rel=0.25)
    with pytest.raises(ModelError):
        measured_shape(ambid.identify(RIG, records[0]).comparison, "flux")


def misfit_of(model, one):
    return ambid.compare(model, one).misfit


@pytest.mark.slow
def test_the_catalogue_names_it(records):
    assert ambid.diagnose(RIG, records[0], validate=records[1:]).effects == ("coulomb_friction",)


@pytest.mark.slow
def test_none_is_the_first_answer_and_the_note_has_the_shape(found):
    assert found.verdict == "none_of_the_candidates", found
    assert the(found, "missing_shape").values["shape"] == "sign ds/dt"


def test_friction_that_has_no_name_is_told_as_a_shape_and_lags_stay_positive(records):
    few = [effect for effect in NAMELESS if effect.name in ("loop_delay", "sensor_lag")]
    found = ambid.diagnose(RIG, records[0], catalogue=few)
    assert (found.verdict, found.effects) == ("none_of_the_candidates", ()), found
    shown = the(found, "missing_shape").values
    assert (shown["shape"].split()[0], shown["kind"]) == ("sign", "odd")
    low, high = found.parameters["tau_e"].ci95
    assert 0.0 < low < found.parameters["tau_e"].value < high


def test_the_measured_shape_is_that_of_friction(force):
    shape = MeasuredShape.from_port(force)
    assert (shape.port, shape.over) == ("force", "v")
    slip = np.array([v for v in shape.at if 3.0 * KNEE < abs(v) < 0.015])
    ratio = np.interp(slip, shape.at, shape.values) / (-FRICTION * np.sign(slip))
    assert 0.6 < ratio.mean() < 1.4


@pytest.mark.slow
def test_the_measured_shape_holds_on_another_record(found, force, records):
    train, other = records
    model = found.fit.model
    shape = MeasuredShape.from_port(force)
    for _ in range(3):
        estimate = ambid.identify(found.fit.model.add(shape), train)
        model = estimate.model
        left = next(p for p in ambid.localise(ambid.compare(model, train)).ports if p.name == "force")
        shape = MeasuredShape.from_port(left, before=shape.times(estimate.parameters["measured_shape.factor"].value))
    at = np.array([0.002, 0.005, 0.01, 0.015])
    np.testing.assert_allclose(np.interp(at, shape.at, shape.values), -FRICTION, rtol=0.35)
    for one, most in ((train, 1.1), (other, 1.2)):
        assert misfit_of(model, one) < most < 8.0 < misfit_of(found.fit.model, one)


@pytest.mark.slow
def test_an_effect_of_ones_own_takes_the_error_to_the_noise(found, records):
    train, other = records
    again = ambid.diagnose(RIG, train, validate=[other], catalogue=(*NAMELESS, Friction()))
    assert again.verdict == "explained", again
    assert again.effects == ("friction",)
    assert again.history[-1].misfit == pytest.approx(1.0, abs=0.1)
    assert again.history[-1].validation_misfit < 1.15
    assert again.parameters["friction.force"].value == pytest.approx(FRICTION, rel=0.02)
    assert again.parameters["K_i.A_zeta"].value == pytest.approx(K_I, rel=0.005)


def test_a_model_with_a_measured_shape_is_saved_with_it(force, tmp_path):
    shape = MeasuredShape.from_port(force)
    ambid.Model(RIG).add(shape).save(tmp_path / "model.json")
    again = ambid.Model.load(tmp_path / "model.json", catalogue=(*CATALOGUE, MeasuredShape()))
    assert again.effects == (shape,)


def test_a_linear_shape_is_a_spring():
    """A force of -k s over s is what K_s takes up."""
    spring = MeasuredShape("force", "s", (-1e-4, 0.0, 1e-4), (10.0, 0.0, -10.0))
    i_e = ambid.prbs(7, amplitude=0.2, hold=4)
    own = ambid.Model(RIG).add(spring).simulate(i_e)
    softer = ambid.Model(RIG).with_values({"K_s.A_zeta": RIG.bearings[0].force_displacement[0] - 1e5}).simulate(i_e)
    np.testing.assert_allclose(own.y, softer.y, atol=1e-6 * np.abs(softer.y).max())


NO_SHAPES = {
    "port": ("torque", "v"),
    "signal": ("force", "z"),
    "unequal": ("force", "v", (0.0, 1.0), (1.0,)),
    "not rising": ("force", "v", (0.0, 0.0), (1.0, 2.0)),
}


@pytest.mark.parametrize("name", NO_SHAPES)
def test_what_is_no_shape_is_refused(name, golden):
    with golden.raises(ModelError):
        MeasuredShape(*NO_SHAPES[name])
