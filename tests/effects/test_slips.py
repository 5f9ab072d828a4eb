"""A slip at a value is the rig, or the record, whose gains are scaled by it."""

import numpy as np
import pytest

import ambid
from ambid.effects import find
from ambid.model import Model
from ambid.rig import StateSpaceController, TransferFunctionController
from reference.loop_rigs import BENCH, CROSSED, DIGITAL, LEVITATOR, RIGS, rig

PID = {"proportional": 0.05, "integral": -0.3, "derivative": -0.04}
SCALE = 0.25


def as_state_space(own):
    """The same controller given by its matrices."""
    A, B, C, D = own.controller.state_space(len(own.axes), own.sample_rate)
    keys = own.controller.model_dump(include={"implementation", "delay_samples", "sample_rate"})
    return own.replace(controller=StateSpaceController(A=A, B=B, C=C, D=D, **keys))


def scaled(own, errors):
    """The rig whose file has these gains."""
    if isinstance(own.controller, StateSpaceController):
        update = {key: (1.0 + errors["gain"]) * np.asarray(getattr(own.controller, key)) for key in "CD"}
        return own.replace(controller=StateSpaceController(**own.controller.model_dump() | update))
    update = {gain: (1.0 + error) * np.asarray(getattr(own.controller, gain)) for gain, error in errors.items()}
    update = {gain: value.tolist() for gain, value in update.items()}
    return own.replace(controller=type(own.controller)(**own.controller.model_dump(exclude_none=True) | update))


DELAYED = RIGS["digital, delay 1.5, twice the rate"]
PER_AXIS = rig(**CROSSED, **DIGITAL | {"delay_samples": 0.3, "integral": (2e5, 0.0, 1e5, 3e5)})
CONTROLLERS = {
    **{name: (own, PID) for name, own in RIGS.items()},
    "digital, gains of each axis": (PER_AXIS, PID),
    "no integral": (rig(integral=0.0), {"proportional": 0.05, "derivative": -0.04}),
    "state space, analog": (as_state_space(RIGS["analog, rotating"]), {"gain": -0.06}),
    "state space, digital": (as_state_space(DELAYED), {"gain": -0.06}),
}
EXCITED = (*RIGS, "state space, analog", "state space, digital")


def excitation(own, samples=300):
    return 0.1 * np.random.default_rng(3).choice([-1.0, 1.0], (samples, len(own.axes)))


def outputs(model, u):
    return model.loop.simulate(model.theta, u)


def alike(found, expected, tolerance=1e-10):
    peaks = np.abs(expected).max(axis=0)
    assert np.abs(found - expected).max(axis=0) == pytest.approx(0.0 * peaks, abs=tolerance * peaks.max())
    assert (np.abs(found - expected).max(axis=0) <= tolerance * peaks).all()


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controller_gain_error_is_a_rig_file_with_other_gains(name):
    own, errors = CONTROLLERS[name]
    u = excitation(own)
    model, expected = Model(own).add("controller_gain_error", errors), Model(scaled(own, errors))
    assert not np.allclose(outputs(Model(own), u), outputs(expected, u), rtol=1e-3)
    alike(outputs(model, u), outputs(expected, u))
    alike(model.simulator().run(u), outputs(expected, u))
    f = np.geomspace(3.0, 3000.0, 20)
    response, of_scaled = (m.loop.frequency_response(m.theta, f) for m in (model, expected))
    np.testing.assert_allclose(response, of_scaled, rtol=1e-8, atol=1e-9 * np.abs(of_scaled).max())
    found, poles = np.sort(np.abs(model.poles())), np.sort(np.abs(expected.poles()))
    np.testing.assert_allclose(found, poles, rtol=1e-7)


@pytest.mark.parametrize("name", EXCITED)
@pytest.mark.parametrize("delay", [0.0, 1.3e-5])
def test_excitation_gain_error_is_a_larger_excitation(name, delay):
    own, _ = CONTROLLERS[name]
    base = Model(own) if delay == 0.0 else Model(own).add("loop_delay", {"delay": delay})
    u = excitation(own)
    model = base.add("excitation_gain_error", {"scale": SCALE})
    alike(outputs(model, u), outputs(base, (1.0 + SCALE) * u))
    np.testing.assert_array_equal(model.poles(), base.poles())


@pytest.mark.parametrize(
    "name", ["analog", "digital, delay 1.5, twice the rate", "digital, delay 0.3, ideal amplifier"]
)
def test_gain_errors_with_a_delay_of_the_loop(name):
    own, u = RIGS[name], excitation(RIGS[name])
    model, expected = (Model(one).add("loop_delay", {"delay": 1.3e-5}) for one in (own, scaled(own, PID)))
    alike(outputs(model.add("controller_gain_error", PID), u), outputs(expected, u))


@pytest.mark.parametrize("name", ["analog, one axis", "digital, delay 0.5, one axis", "digital, delay 1, rotating"])
def test_slips_beside_a_nonlinear_effect(name):
    own = RIGS[name]
    u = 5.0 * excitation(own)
    model, expected = (Model(one, substeps=16).add("force_nonlinearity") for one in (own, scaled(own, PID)))
    model = model.add("controller_gain_error", PID).add("excitation_gain_error", {"scale": SCALE})
    alike(outputs(model, u), outputs(expected, (1.0 + SCALE) * u))
    alike(model.simulator().run(u), outputs(expected, (1.0 + SCALE) * u))
    slopes_are_differences(model, u)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_slopes_by_slips(name):
    own, errors = CONTROLLERS[name]
    model = Model(own).add("controller_gain_error", errors).add("excitation_gain_error", {"scale": SCALE})
    slopes_are_differences(model, excitation(own))


def slopes_are_differences(model, u):
    free = model.index(["controller_gain_error", "excitation_gain_error"])
    y, slopes = model.loop.sensitivity(model.theta, u, free)
    alike(y, outputs(model, u), 1e-12)
    for j, k in enumerate(free):

        def moved(steps, k=k):
            theta = model.theta
            theta[k] += 5e-4 * steps
            return model.loop.simulate(theta, u)

        expected = (8.0 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / 6e-3
        assert np.abs(slopes[:, :, j] - expected).max(axis=0) == pytest.approx(0.0, abs=5e-8 * np.abs(expected).max())


def test_gains_that_a_controller_has():
    names = lambda own: [p.name for p in find("controller_gain_error").parameters(own)]  # noqa: E731
    assert names(BENCH) == ["proportional", "integral", "derivative"]
    assert names(rig(integral=0.0)) == ["proportional", "derivative"]
    lead = TransferFunctionController(implementation="analog", numerator=(1.5, 8e3), denominator=(1e-4, 1.0))
    assert names(LEVITATOR.replace(controller=lead)) == ["gain"]


def test_controllers_of_several_operating_points():
    """A gain that only one of two controllers has is scaled where it is."""
    pd = RIGS["analog"].replace(controller=RIGS["analog"].controller.model_copy(update={"integral": 0.0}))
    i_e = ambid.prbs(7, amplitude=0.1, hold=2, axes=4, periods=2)
    record = Model(pd).simulate(i_e).at(pd)
    model = Model(RIGS["analog"]).covering([record]).add("controller_gain_error", PID)
    expected = Model(scaled(pd, {"proportional": 0.05, "derivative": -0.04})).simulate(i_e)
    alike(model.response(record), np.hstack([expected.y, expected.i_c]))
