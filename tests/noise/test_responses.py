"""Measured responses beside modelled ones: exact where a model is linear, asked alike where it is not."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import ambid
from ambid.errors import InputError


@pytest.fixture(scope="module")
def comparison(bench, run):
    return ambid.compare(ambid.Model(bench.rig()), run)


def test_a_linear_model_is_exact_and_dense(comparison, run):
    shown = ambid.frequency_responses(comparison)
    (own,) = shown.modelled
    model = comparison.model
    exact = model.loop.transfer(model.theta, np.exp(2j * np.pi * own.frequency_hz * model.loop.sample_time))
    assert_allclose(own.response, exact[:, :8, :4], atol=1e-12 * np.abs(exact).max())
    assert len(own.frequency_hz) > 500
    assert_allclose(shown.measured.response, run.frequency_response().response)
    assert own.at_measured.shape == shown.measured.response.shape


def test_what_the_right_model_leaves_is_noise(comparison):
    assert np.nanmedian(ambid.frequency_responses(comparison).left()) < 1.5


def test_the_model_before_stands_beside(comparison):
    wrong = comparison.model.with_values({"K_i.B_eta": 190.0})
    shown = ambid.frequency_responses(comparison, before=[wrong])
    assert len(shown.modelled) == 2
    assert shown.modelled[0].name == shown.modelled[1].name == "base model"
    mean = np.nanmean(shown.left(1), axis=0)
    assert mean[shown.place(*shown.worst)] == mean.max() > 2.0
    assert np.nanmax(np.nanmean(shown.left(0), axis=0)) < 1.8


def test_a_nonlinear_model_is_asked_what_the_record_is_asked(comparison, run):
    model = comparison.model.add("force_nonlinearity")
    shown = ambid.frequency_responses(comparison.of(model))
    (own,) = shown.modelled
    assert own.name == "force_nonlinearity"
    assert_allclose(own.frequency_hz, shown.measured.frequency_hz)
    simulated = np.asarray(comparison.of(model).records[0].simulated)
    asked = replace(run, y=simulated[:, :4], i_c=simulated[:, 4:]).frequency_response()
    assert_allclose(own.response, asked.response)


def test_a_frequency_response_is_measured_already(comparison, run):
    measured = run.frequency_response()
    shown = ambid.frequency_responses(ambid.compare(comparison.model, measured))
    assert shown.measured is measured


def test_wrong_records_and_pairs_are_named(comparison, golden):
    with pytest.raises(InputError, match="record = 2"):
        ambid.frequency_responses(comparison, 2)
    with golden.raises(InputError):
        ambid.frequency_responses(comparison).place("y.A_zeta", "i_e.C_eta")


def test_it_is_plain_data(comparison):
    shown = ambid.frequency_responses(comparison, before=[comparison.model])
    plain = json.loads(json.dumps(shown.to_json(), allow_nan=False))
    assert np.shape(plain["model"]) == np.shape(plain["response"]) == np.shape(plain["before"][0]["model"])
    assert plain["before"][0]["name"] == "base model"
