"""Many fits in noise whose size is known: least squares as SciPy has it, intervals that hold, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from ambid.errors import ModelError
from ambid.excitation import prbs
from ambid.identification import identify_many
from ambid.model import Model
from hidden.one_axis import ONE_AXIS
from validated import relative

NOISE = {"y": 2e-7, "i_c": 1e-2}


def start(off=1.1):
    model = Model(ONE_AXIS.rig)
    return model.with_values({p.name: off * p.value for p in model.parameters if p.name.startswith("K_i")})


def records(seeds, noise=NOISE):
    """Of the model itself, with white noise on what is recorded."""
    model = Model(ONE_AXIS.rig)
    clean = model.simulate(prbs(6, amplitude=0.1, hold=4, axes=1, periods=2))
    for seed in seeds:
        random = np.random.default_rng(seed)
        y, i_c = (z + noise[name] * random.standard_normal(z.shape) for name, z in (("y", clean.y), ("i_c", clean.i_c)))
        yield replace(clean, y=y, i_c=i_c)


@pytest.mark.parametrize("before", [0, 9])
def test_the_least_squares_of_scipy(before, validated):
    """Alone, and as the last of repeats, which take their last step unseen."""
    model, *others, record = start(), *records(range(100, 100 + before)), *records([3])
    noise = np.array([NOISE["y"], NOISE["i_c"]])

    def residual(x):
        left = (model.with_theta(x * model.theta).response(record) - np.hstack([record.y, record.i_c])) / noise
        return (left - left.mean(axis=0)).ravel()

    expected = least_squares(residual, np.ones(len(model.theta)), jac="3-point", xtol=1e-12, ftol=1e-12, gtol=1e-12)
    covariance = np.linalg.inv(expected.jac.T @ expected.jac)
    errors = np.sqrt(np.diag(covariance))
    found = identify_many(model, [*others, record], noise=NOISE)
    validated(
        "Estimates in noise of known size: difference in standard errors",
        "least_squares of SciPy {scipy}",
        (found.values[-1] / model.theta - expected.x) / errors,
        1e-4,
    )
    validated(
        "Covariance in noise of known size: relative difference",
        "(J'J)^-1 of least_squares of SciPy {scipy}",
        relative(found.covariances[-1] / np.outer(model.theta, model.theta), covariance),
        1e-4,
    )
    dof = 2 * (record.samples - 1) - len(model.theta)
    assert found.misfit[-1] == pytest.approx(2 * expected.cost / dof, rel=1e-9)
    assert found.status[-1] == "converged"
    assert found.adequate[-1]


def test_intervals_hold_the_truth(validated):
    runs = 200
    found = identify_many(start(), records(range(runs)), noise=NOISE)
    off = (found.values - Model(ONE_AXIS.rig).theta) / found.std_errors
    inside = np.count_nonzero(np.abs(off) < 1.96)
    validated(
        "95 % intervals in noise of known size, 200 runs: deviation of their coverage from 0.95",
        "truth of the model; 4 binomial standard deviations",
        inside / off.size - 0.95,
        4 * np.sqrt(0.95 * 0.05 / off.size),
    )
    assert abs(found.misfit.mean() - 1.0) < 0.01


def test_a_channel_without_noise_is_left_out():
    of_y = identify_many(start(), records([1]), noise={"y": NOISE["y"]})
    without = [replace(record, i_c=None) for record in records([1])]
    assert of_y.values == pytest.approx(identify_many(start(), without, noise=NOISE).values, rel=1e-9)
    by_channel = identify_many(start(), records([1]), noise={"y.A_zeta": NOISE["y"]})
    assert of_y.values == pytest.approx(by_channel.values, rel=1e-9)


def test_more_noise_than_was_said_is_told():
    loud = list(records([5], {"y": 2 * NOISE["y"], "i_c": 2 * NOISE["i_c"]}))
    found = identify_many(start(), loud, noise=NOISE)
    assert found.misfit[0] == pytest.approx(4.0, rel=0.2)
    assert not found.adequate[0]


def test_an_unstable_start_moves_as_that_of_identify():
    wild = Model(ONE_AXIS.rig).with_values({"K_i.A_zeta": 0.3 * Model(ONE_AXIS.rig).theta[0]})
    assert not wild.is_stable
    found = identify_many(wild, records([2]), noise=NOISE)
    assert found.values == pytest.approx(identify_many(start(), records([2]), noise=NOISE).values, rel=1e-4)


@pytest.mark.parametrize(
    "options",
    [{"noise": {"z": 1.0}}, {"noise": {"y": 0.0}}, {"noise": {"y": 1e-7}, "weights": "eq9"}],
    ids=["channel", "rms", "weights"],
)
def test_what_makes_no_sense_is_no_row(options, golden):
    with golden.raises(ModelError):
        identify_many(start(), records([0]), **options)


def test_a_record_that_noise_says_nothing_of_is_a_row(golden):
    without = [replace(record, i_c=None) for record in records([1])]
    golden.holds(identify_many(start(), without, noise={"i_c": 1e-2}).reasons[0])
    (record,) = records([1])
    response = replace(record, period=record.samples // 2).frequency_response()
    golden.holds(identify_many(start(), [response], noise=NOISE).reasons[0])
