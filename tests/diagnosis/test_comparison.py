"""Comparison: fit, ceiling and misfit against their definitions, and the channel that is to blame."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid import prbs
from ambid.diagnosis import compare
from ambid.errors import RecordError, UnstableLoopError
from ambid.identification import identify
from ambid.model import Model
from ambid.noise import noise_ceiling
from ambid.record import Record
from virtual import AXES

CHANNELS = [f"{signal}.{axis}" for signal in ("y", "i_c") for axis in AXES]


@pytest.fixture(scope="module")
def exact(bench):
    return Model(bench.rig())


@pytest.fixture(scope="module")
def comparison(exact, run):
    return compare(exact, run)


def test_fit_is_as_defined(bench, comparison, run):
    (record,) = comparison.records
    measured = np.hstack([run.y, run.i_c])
    from_rest = bench.respond(run.i_e)[:, :, 0]
    for k, channel in enumerate(record.channels):
        z, zhat, other = (s[:, k] - s[:, k].mean() for s in (measured, record.simulated, from_rest))
        assert channel.channel == CHANNELS[k]
        assert_allclose(channel.fit_percent, 100 * (1 - np.linalg.norm(z - other) / np.linalg.norm(z)), atol=0.1)
        assert channel.unit == ("m" if k < 4 else "A")
        assert_allclose(channel.fit_percent, 100 * (1 - np.linalg.norm(z - zhat) / np.linalg.norm(z)), rtol=1e-9)
        assert_allclose(channel.residual_rms, (z - zhat).std(), rtol=1e-9)
        assert_allclose(channel.noise_ceiling_percent, noise_ceiling(run)[channel.channel], atol=0.1)
        assert_allclose(channel.noise_ceiling_percent, 100 * (1 - channel.noise_rms / z.std()), rtol=1e-9)


def test_the_exact_model_reaches_the_ceiling(comparison):
    (record,) = comparison.records
    for channel in record.channels:
        assert abs(channel.fit_percent - channel.noise_ceiling_percent) < 0.5
        assert_allclose(channel.residual_rms, channel.noise_rms, rtol=0.12)
        assert abs(channel.misfit - 1.0) < 0.35
    assert abs(record.misfit - 1.0) < 0.1
    assert record.repeatable_share < 0.1


def test_what_is_fitted_is_what_is_compared(exact, run):
    estimate = identify(exact, run)
    again, renewed = compare(estimate.model, run), estimate.comparison.renewed()
    assert_allclose(again.misfit, renewed.misfit, rtol=1e-9)
    for channel, fit in again.fit_percent.items():
        assert_allclose(fit, renewed.fit_percent[channel], rtol=1e-9)
        assert_allclose(fit, estimate.fit_percent[channel], rtol=1e-6)  # in the noise before, another transient


def test_the_residual_has_no_mean(comparison, run):
    (record,) = comparison.records
    assert record.residual.shape == (run.samples, 8)
    assert_allclose(record.residual.mean(axis=0) / record.residual.std(axis=0), 0.0, atol=1e-9)


def test_the_channel_that_is_wrong_is_the_worst(exact, run):
    y = run.y.copy()
    y[:, 2] *= 1.2
    comparison = compare(exact, replace(run, y=y, name="spoilt"))
    name, channel = comparison.worst
    assert (name, channel.channel) == ("spoilt", "y.B_zeta")
    assert channel.misfit > 10.0
    assert comparison.records[0].misfit > 10.0
    assert comparison.records[0].repeatable_share > 0.9


def test_offsets_do_not_matter(exact, run, comparison):
    lifted = compare(exact, replace(run, y=run.y + 1e-5, i_c=run.i_c - 3.0))
    assert_allclose(lifted.records[0].misfit, comparison.records[0].misfit, rtol=1e-6)


def test_y_alone(exact, run):
    (record,) = compare(exact, replace(run, i_c=None)).records
    assert [c.channel for c in record.channels] == CHANNELS[:4]
    assert record.residual.shape == (run.samples, 4)
    assert abs(record.misfit - 1.0) < 0.15


def test_two_periods_are_enough(exact, run):
    two = {signal: getattr(run, signal)[: 2 * run.period] for signal in ("i_e", "y", "i_c")}
    comparison = compare(exact, replace(run, **two))
    assert comparison.is_adequate
    assert comparison.misfit == pytest.approx(1.0, abs=0.1)


def test_of_too_short_a_record_only_the_fit_is_known(exact, run, golden):
    brief = {signal: getattr(run, signal)[:40] for signal in ("i_e", "y", "i_c")}
    comparison = compare(exact, replace(run, **brief, period=None))
    (record,) = comparison.records
    assert not comparison.is_judged
    assert np.isnan([comparison.misfit, comparison.bound, record.misfit, record.repeatable_share]).all()
    with golden.raises(RecordError):
        comparison.noise  # noqa: B018
    (plain,) = comparison.to_json()["records"]
    assert plain["misfit"] is plain["repeatable_share"] is plain["channels"][0]["noise_rms"] is None
    assert plain["fit_percent"]["average"] > 90.0


def test_without_periods_the_misfit_of_the_right_model_is_one(exact, run):
    (record,) = compare(exact, replace(run, period=None)).records
    assert record.misfit == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("samples", [None, 30])
def test_without_noise_and_periods_or_length_there_is_no_misfit(exact, samples):
    i_e = prbs(7, amplitude=0.1, hold=4, axes=4, periods=4)[:samples]
    (record,) = compare(exact, replace(exact.simulate(i_e), period=None)).records
    assert np.isnan(record.misfit)
    assert all(channel.fit_percent > 99.0 for channel in record.channels)


def test_without_noise_there_is_no_misfit(exact):
    """What differs between periods is a transient along a few directions; the rest of its covariance is rounding."""
    i_e = prbs(7, amplitude=0.1, hold=4, axes=4, periods=4)
    (record,) = compare(exact, replace(exact.simulate(i_e), period=508)).records
    assert np.isnan(record.misfit)
    assert all(channel.fit_percent > 99.0 for channel in record.channels)


def test_several_records(exact, run):
    comparison = compare(exact, [run, replace(run, name="other")])
    assert [r.record.name for r in comparison.records] == [run.name, "other"]
    assert [r["record"] for r in comparison.to_json()["records"]] == [run.name, "other"]


def test_what_it_says(comparison):
    for text in (*CHANNELS, "misfit", "ceiling", "um", "mA", "1 when the model is right"):
        assert text in str(comparison)
    (plain,) = comparison.to_json()["records"]
    assert set(plain["fit_percent"]) == set(plain["noise_ceiling_percent"]) == {*CHANNELS, "average"}
    assert [c["channel"] for c in plain["channels"]] == CHANNELS


def test_wrong_records_and_models(exact, run, golden):
    with golden.raises(RecordError):
        compare(exact, replace(run, axes=AXES[::-1]))
    with golden.raises(RecordError):
        compare(exact, replace(run, i_e=None))
    with pytest.raises(UnstableLoopError):
        compare(exact.with_values({"tau_e": 2e-3}), run)


def test_a_transient_that_outlasts_the_first_period_is_no_noise():
    random, n, periods, noise = np.random.default_rng(3), 500, 6, 0.05
    signal = np.tile(random.standard_normal((n, 1)), (periods, 1))
    measured = signal + noise * random.standard_normal((n * periods, 1))
    decay = 8.0 * np.exp(-np.arange(n * periods)[:, None] / (0.6 * n))
    i_e = np.tile(prbs(9, amplitude=0.1, axes=1)[:n], (periods, 1))
    ceilings = [
        noise_ceiling(Record("run", 1e4, ("a",), i_e, y, period=n))["y.a"] for y in (measured, measured + decay)
    ]
    assert ceilings[0] == pytest.approx(100.0 * (1.0 - noise), abs=0.3)
    assert ceilings[1] == pytest.approx(ceilings[0], abs=0.6)
