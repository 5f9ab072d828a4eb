"""A nonlinear response in time: the steady state after a short lead is that after a long one."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from ambid import Model, compare, prbs
from ambid.loop.effect import Tone
from ambid.noise.in_time import InTime
from ambid.noise.lines import RecordLines
from hidden.one_axis import ONE_AXIS

PERIOD = 1020


@pytest.fixture(scope="module")
def judged():
    """A saturating model, the lines of a record of it, and its response in time."""
    model = Model(ONE_AXIS.rig).add("force_nonlinearity")
    i_e = prbs(8, amplitude=1.0, hold=4, periods=4)
    record = replace(model.virtual_experiment(i_e, sensor_noise=5e-8, current_noise=5e-3, seed=1), period=PERIOD)
    (part,) = compare(model, record).noise.parts
    return model.at(record), part, InTime(part.record, part.window, part.judged_lines, part.lines_of_period)


def test_a_start_from_the_linear_steady_state_is_as_good_as_a_long_lead(judged):
    """Beside what transients take over, by far less than a unit of the noise."""
    here, part, in_time = judged
    inputs = np.tile(here.excitation(part.record)[:PERIOD], (20, 1))
    folded, _ = here.loop.core.folded(here.theta, [], inputs, 19 * PERIOD, PERIOD, 4.0)
    long = part.whiten(part.window.of_period(folded[:, : in_time.channels]))
    basis = part.transients(here)
    for near in (in_time.nearly(here, [])[0], in_time.lines(here, [], at_rest=False)[0]):
        left = part.whiten(near) - long
        assert np.linalg.norm(left - basis @ (basis.T @ left)) < 0.05
    linear = here.without("force_nonlinearity").response(part.record)[-PERIOD:]
    assert np.linalg.norm(part.whiten(part.window.of_period(4.0 * linear)) - long) > 10.0


@pytest.mark.parametrize("inverse_width", np.geomspace(1e4, 2.5e5, 8))
def test_what_creeps_does_not_lengthen_the_lead(judged, inverse_width):
    """A spring that sticks hardly forgets, at a rate whose last digits are rounding: that is no slow pole."""
    own, part, in_time = judged
    values = {"force": 1.0, "inverse_width": inverse_width, "inverse_exponent": 0.5}
    here = own.without("force_nonlinearity").add("coulomb_friction", values).with_substeps(2)
    short, long = in_time.nearly(here, [])[0], in_time.lines(here, [], at_rest=False)[0]
    assert not np.array_equal(short, long), "a long lead was taken"


def test_between_the_excited_lines_a_settled_response_is_nothing(judged):
    """Of a record with a tone as of one without: simulated sample by sample, from a start that is forgotten."""
    here, part, _ = judged
    with_tone = RecordLines(here.without("force_nonlinearity"), part.measured, [Tone(50.0, 0, 1e3)])
    ways = with_tone.judged_lines, with_tone.lines_of_period
    own, one_by_one = InTime(part.record, part.window, *ways, are_between=True), part.record.samples
    lead = np.tile(here.excitation(part.record)[:PERIOD], (20, 1))
    simulated = here.loop.core.simulate(here.theta, np.vstack([lead, here.excitation(part.record)]))[-one_by_one:]
    expected = with_tone.whiten(with_tone.judged_lines(simulated[:, : own.channels]))
    assert len(with_tone.more) > 0
    assert_array_equal(own.lines(here, [], at_rest=False)[0][-len(with_tone.more) :], 0.0)
    left = with_tone.whiten(own.lines(here, [], at_rest=False)[0]) - expected
    basis = with_tone.transients(here)
    assert np.linalg.norm(left - basis @ (basis.T @ left)) < 0.1


def test_a_response_does_not_depend_on_those_before(judged):
    own, part, in_time = judged
    here = own.with_substeps(2)
    free = list(range(len(here.names)))
    with_slopes, slopes = in_time.lines(here, free, at_rest=True)
    known, none = in_time.lines(here, [], at_rest=True)
    fresh, _ = InTime(part.record, part.window, part.judged_lines, part.lines_of_period).lines(here, free, at_rest=True)
    assert (slopes.shape[2], none.shape[2]) == (len(free), 0)
    assert_array_equal(known, with_slopes)
    assert_array_equal(fresh, with_slopes)
    assert not np.array_equal(in_time.lines(here, [], at_rest=False)[0], known)


def test_derivatives_of_a_response_that_need_not_repeat_come_in_groups(judged, monkeypatch):
    """As many at a time as memory holds; one at a time they are the same."""
    here, part, _ = judged
    here = here.with_substeps(2)
    free = list(range(len(here.names)))
    in_time = InTime(part.record, part.window, part.judged_lines, part.lines_of_period, are_between=True)
    response, slopes = in_time.lines(here, free, at_rest=True)
    monkeypatch.setattr("ambid.noise.in_time.AT_A_TIME", 1)
    alone, one_by_one = InTime(
        part.record, part.window, part.judged_lines, part.lines_of_period, are_between=True
    ).lines(here, free, at_rest=True)
    np.testing.assert_allclose(alone, response, rtol=1e-9)
    np.testing.assert_allclose(one_by_one, slopes, rtol=1e-9)


def test_rough_derivatives_lead_to_the_same_minimum(judged):
    """All but those of the nonlinear effect are the linear model's: nearly parallel to the exact ones."""
    here, part, _ = judged
    here = here.with_substeps(2)
    free = list(range(len(here.names)))
    exact, rough = part.white(here, free), part.white(here, free, roughly=True)
    assert_array_equal(rough.residual, exact.residual)
    alike = np.sum(exact.slopes * rough.slopes, axis=0)
    alike /= np.linalg.norm(exact.slopes, axis=0) * np.linalg.norm(rough.slopes, axis=0)
    assert alike.min() > 0.95
    own = [name.startswith("force_nonlinearity") for name in here.names]
    np.testing.assert_allclose(rough.slopes[:, own], exact.slopes[:, own], atol=1e-6 * np.abs(exact.slopes).max())
