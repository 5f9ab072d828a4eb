"""A frequency response against a model: exact slopes, a misfit of one, intervals that hold the truth; with records."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import FrequencyResponse, Model, Record, compare, identify, prbs
from ambid.effects.magnet import ForceNonlinearity
from ambid.errors import ModelError, RecordError, UnstableLoopError
from ambid.noise.response_lines import ResponseLines
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig


def response_of(model, f, share=0.01, seed=0, covariance=None):
    """What the loop answers at some frequencies, with noise of a share of it, of known std."""
    loop = model.loop
    h = loop.transfer(model.theta, np.exp(2j * np.pi * f * loop.sample_time))[:, :, : len(model.rig.axes)]
    std = share * np.abs(h) + 1e-3 * np.abs(h).max(axis=(0, 2), keepdims=True)
    random = np.random.default_rng(seed).standard_normal((2, *h.shape))
    noise = std * (random[0] + 1j * random[1]) / np.sqrt(2.0)
    inputs = [name for name in loop.inputs if name.startswith("i_e.")]
    return FrequencyResponse("frf", f, h + noise, std, loop.outputs, tuple(inputs))


@pytest.fixture(scope="module")
def truth(bench):
    return Model(bench.rig())


F = np.geomspace(3.0, 3000.0, 120)


@pytest.mark.parametrize("effect", [None, "loop_delay", "seal_forces"])
def test_slopes_are_those_of_the_response(truth, effect):
    model = truth if effect is None else truth.add(effect)
    part = ResponseLines(response_of(truth, F), truth)
    free = list(range(len(model.names)))
    slopes = part.slopes(model, free)
    for k in free:
        step = 1e-5 * model.parameters[k].scale
        moved = []
        for sign in (1.0, -1.0):
            theta = model.theta
            theta[k] += sign * step
            moved.append(part.departure(model.with_theta(np.maximum(theta, 0.0) if effect else theta)))
        difference = (moved[0] - moved[1]) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, k], difference, atol=2e-5 * np.abs(difference).max())


def test_the_exact_model_has_a_misfit_of_one(truth):
    misfits = [compare(truth, response_of(truth, F, seed=seed)).misfit for seed in range(5)]
    assert np.mean(misfits) == pytest.approx(1.0, abs=0.02)
    assert np.std(misfits) < 0.03
    found = compare(truth, response_of(truth, F))
    assert found.is_adequate
    for channel in found.records[0].channels:
        assert channel.misfit == pytest.approx(1.0, abs=0.2)
        assert channel.fit_percent == pytest.approx(channel.noise_ceiling_percent, abs=1.0)
        assert channel.unit == ("m/A" if channel.channel.startswith("y.") else "A/A")
    assert found.fit_percent["average"] == pytest.approx(found.noise_ceiling_percent["average"], abs=1.0)


def test_pairs_that_were_not_measured_count_for_nothing(truth):
    whole = response_of(truth, F)
    h, std = whole.response.copy(), whole.std.copy()
    h[10:60, 2, 1] = h[:, :, 3] = np.nan
    std[np.isnan(h)] = np.nan
    found = compare(truth, replace(whole, response=h, std=std))
    assert found.dof == 2 * int(np.isfinite(h).sum()) - len(truth.names)
    assert found.misfit == pytest.approx(1.0, abs=0.06)
    assert identify(truth, replace(whole, response=h, std=std)).is_adequate


def test_a_wrong_model_is_told(truth):
    found = compare(truth.with_values({"tau_e": 1.3 * truth.rig.actuator.time_constant}), response_of(truth, F))
    assert found.misfit > 5.0
    assert not found.is_adequate


def test_the_noise_of_all_pairs_may_be_correlated(truth):
    """The misfit of noise that goes through a known mixture is 1 with its covariance, and not with its std alone."""
    clean = response_of(truth, F, share=0.0)
    random, pairs = np.random.default_rng(3), clean.response[0].size
    mixture = np.tril(random.standard_normal((pairs, pairs))) + 2.0 * np.eye(pairs)
    scale = 0.01 * np.abs(clean.response).reshape(len(F), -1) + clean.std.reshape(len(F), -1)
    white = (random.standard_normal((2, len(F), pairs)) / np.sqrt(2.0)).T
    error = scale * ((white[..., 0] + 1j * white[..., 1]).T @ mixture.T)
    covariance = scale[:, :, None] * (mixture @ mixture.T) * scale[:, None, :] + 0j
    std = np.sqrt(np.einsum("kii->ki", covariance).real).reshape(clean.std.shape)
    model_h = ResponseLines(clean, truth).simulated(truth)
    own = replace(clean, response=model_h + error.reshape(model_h.shape), std=std, covariance=covariance)
    assert compare(truth, own).misfit == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_errors_that_go_together_count_as_fewer(truth, share):
    """Where the std alone is known, the scatter of the residual over frequency gives sum l^2 / sum l to a third.

    A misfit that is smooth over frequency does not bring more.
    """
    clean, found = response_of(truth, F, share=0.0), []
    model_h = ResponseLines(clean, truth).simulated(truth)
    off = truth.with_values({"tau_e": 1.3 * truth.rig.actuator.time_constant})
    for seed in range(10):
        random = np.random.default_rng(seed).standard_normal((2, len(F), 1 + clean.response[0].size)) / np.sqrt(2.0)
        white = random[0] + 1j * random[1]
        mixed = np.sqrt(1.0 - share) * white[:, 1:] + np.sqrt(share) * white[:, :1]
        own = replace(clean, response=model_h + clean.std * mixed.reshape(model_h.shape))
        found.append([np.mean(ResponseLines(own, model).spreads) for model in (truth, off)])
    pairs = clean.response[0].size
    expected = 1.0 + (pairs - 1) * share**2
    at_truth, with_misfit = np.mean(found, axis=0)
    assert at_truth == pytest.approx(expected, rel=0.33)
    assert with_misfit < 1.33 * expected


def test_a_channel_that_the_loop_lacks_is_refused(truth, golden):
    other = replace(response_of(truth, F), outputs=tuple(f"y.{k}" for k in range(8)))
    with golden.raises(RecordError):
        compare(truth, other)


def test_eq_9_is_for_records_in_time(truth, golden):
    with golden.raises(ModelError):
        identify(truth, response_of(truth, F), weights="eq9")


def test_an_unstable_model_is_refused(truth):
    with pytest.raises(UnstableLoopError):
        compare(truth.with_values({"K_i.A_zeta": 1.0}), response_of(truth, F))


def test_a_nonlinear_model_acts_as_at_rest(truth):
    """The force law is the linear one near rest; a record at large amplitude would distinguish them."""
    own = response_of(truth, F)
    law = truth.add("force_nonlinearity", {"bias_ratio": 1.0})
    assert compare(law, own).cost == pytest.approx(compare(truth, own).cost)
    part = ResponseLines(own, truth)
    index = law.names.index("force_nonlinearity.bias_ratio")
    assert not part.slopes(law, [index]).any()


def test_what_acts_at_rest_too_is_refused(truth, golden):
    """The force law about a current that holds a weight."""
    loaded = truth.add(ForceNonlinearity((0.5, 0.5, 0.5, 0.5)), {"bias_ratio": 1.0})
    with golden.raises(ModelError):
        compare(loaded, response_of(truth, F))


def test_beside_a_record_intervals_are_smaller(bench, truth, run):
    own = response_of(truth, F)
    together, alone, in_time = (identify(bench.rig(0.03), records) for records in ((run, own), own, run))
    assert together.is_adequate
    for name in together.parameters:
        errors = [e.parameters[name].std_error for e in (alone, in_time)]
        assert together.parameters[name].std_error < 1.02 * min(errors)
        assert 1.0 / together.parameters[name].std_error ** 2 == pytest.approx(sum(1.0 / e**2 for e in errors), rel=0.2)


def test_fits_of_records_and_responses_together_are_those_in_time(truth, run):
    alone, together = compare(truth, run), compare(truth, (run, response_of(truth, F)))
    assert together.fit_percent["y.A_zeta"] == pytest.approx(alone.fit_percent["y.A_zeta"], abs=0.01)
    assert together.records[1].channels[0].unit == "m/A"


def test_channels_that_only_some_responses_have_do_not_weigh(truth):
    """The fit of y is that of as many values of each, whatever else one of them holds."""
    both, alone = response_of(truth, F, 0.02, 1), response_of(truth, F, 0.3, 2)
    alone = replace(alone, response=alone.response[:, :1], std=alone.std[:, :1], outputs=alone.outputs[:1])
    found = compare(truth, (both, alone))
    rows = [own.channels[0] for own in found.records]
    left = sum((row.measured_rms * (1.0 - row.fit_percent / 100.0)) ** 2 for row in rows)
    share = np.sqrt(left / sum(row.measured_rms**2 for row in rows))
    assert found.fit_percent["y.A_zeta"] == pytest.approx(100.0 * (1.0 - share), abs=1e-9)


def coverage(estimates, values):
    inside = [
        [e.parameters[name].ci95[0] <= value <= e.parameters[name].ci95[1] for name, value in values.items()]
        for e in estimates
    ]
    return np.mean(inside)


@pytest.mark.slow
def test_intervals_hold_the_truth(bench, truth, validated):
    start = bench.rig(0.03)
    estimates = [identify(start, response_of(truth, F, seed=seed)) for seed in range(100)]
    validated(
        "95 % intervals from frequency responses, 100 seeds: deviation of their coverage from 0.95",
        "truth of an independent bench",
        coverage(estimates, bench.truth) - 0.95,
        0.025,
    )
    assert np.mean([e.misfit for e in estimates]) == pytest.approx(1.0, abs=0.01)
    assert all(e.is_adequate for e in estimates)


@pytest.mark.slow
def test_intervals_of_responses_made_from_records_hold_the_truth(truth, bench):
    """Four axes excited together; a few are lost to what no polynomial is."""
    i_e = prbs(11, amplitude=0.15, hold=2, axes=4, periods=3)
    estimates = []
    for record in bench.records(i_e, range(30), period=4094):
        estimates.append(identify(bench.rig(0.03), record.frequency_response()))
    assert coverage(estimates, bench.truth) > 0.9
    assert np.mean([e.misfit for e in estimates]) == pytest.approx(1.0, abs=0.06)


@pytest.mark.slow
def test_one_axis_without_periods():
    model, estimates = Model(RIG), []
    for seed in range(40):
        i_e = np.random.default_rng(seed).standard_normal((6000, 1))
        own = model.virtual_experiment(i_e, seed=1000 + seed)
        record = Record("noise", own.sample_rate, own.axes, own.i_e, own.y, own.i_c)
        estimates.append(identify(RIG, record.frequency_response()))
    assert coverage(estimates, dict(zip(model.names, model.theta, strict=True))) > 0.9


def test_a_value_that_is_noise_alone_does_not_hide_the_fit_of_all_others(truth):
    """Where hardly anything was excited the response is noise, ten times larger than anywhere else."""
    whole = response_of(truth, F)
    h, std = whole.response.copy(), whole.std.copy()
    std[-1] = 10.0 * np.abs(h).max(axis=0)
    h[-1] = std[-1]
    some, found = compare(truth, whole), compare(truth, replace(whole, response=h, std=std))
    for name in ("fit_percent", "noise_ceiling_percent"):
        assert getattr(found, name) == pytest.approx(getattr(some, name), abs=0.5)
