"""Frequency responses that are too short, or lack values or their phase: refused, or reported, and never dropped."""

from warnings import catch_warnings, simplefilter

import numpy as np
import pytest

import ambid
from ambid import FrequencyResponse, Model
from ambid.errors import RecordError
from ambid.noise.response_lines import INDEPENDENT, independent_numbers
from found import the
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig
OUTPUTS, INPUTS = ("y.A_zeta", "i_c.A_zeta"), ("i_e.A_zeta",)
PAIRS = [f"{output} / i_e.A_zeta" for output in OUTPUTS]


def response(f):
    model = Model(RIG)
    h = model.loop.transfer(model.theta, np.exp(2j * np.pi * f / RIG.sample_rate))[:, :, :1]
    random = np.random.default_rng(3)
    std = 0.01 * np.abs(h)
    noise = std * (random.standard_normal(h.shape) + 1j * random.standard_normal(h.shape)) / np.sqrt(2.0)
    return {"frequency_hz": f, "response": h + noise, "std": std, "outputs": OUTPUTS, "inputs": INPUTS}


def with_gaps():
    """One value, one frequency and, of three pairs, no whole one that is missing."""
    table = response(np.linspace(5.0, 1500.0, 60))
    table["response"][4, 1, 0] = np.nan
    table["response"][7] = np.nan
    return table


@pytest.mark.parametrize("count", [1, 2])
def test_a_response_of_fewer_than_three_frequencies_is_refused(tmp_path, count, golden):
    table = response(np.linspace(20.0, 900.0, 3))
    path = tmp_path / "few.csv"
    lines = ["frequency_hz,output,input,re,im,std"]
    for k, o in np.ndindex(count, 2):
        h, std = table["response"][k, o, 0], table["std"][k, o, 0]
        lines.append(f"{table['frequency_hz'][k]},{OUTPUTS[o]},i_e.A_zeta,{h.real},{h.imag},{std}")
    path.write_text("\n".join(lines) + "\n")
    with golden.raises(RecordError):
        ambid.load_measurement(path, RIG)


def test_three_frequencies_are_identified():
    estimate = ambid.identify(RIG, FrequencyResponse.from_arrays(**response(np.linspace(20.0, 900.0, 3)), rig=RIG))
    assert estimate.parameters["K_i.A_zeta"].value == pytest.approx(RIG.bearings[0].force_current[0], rel=0.2)


def test_frequencies_without_a_value_do_not_count(golden):
    table = response(np.linspace(20.0, 900.0, 6))
    table["response"][2:] = np.nan
    with golden.raises(RecordError):
        FrequencyResponse.from_arrays(**table, rig=RIG)


@pytest.mark.parametrize("scatter", [0.0, 1e-7, 1.0, 1e5])
def test_any_scatter_tells_how_many_numbers_are_independent(scatter):
    assert INDEPENDENT[0] <= independent_numbers(scatter) <= INDEPENDENT[1]


def test_missing_values_are_told_with_their_count_pair_and_frequency(golden):
    found = FrequencyResponse.from_arrays(**with_gaps(), rig=RIG, name="frf")
    f = found.frequency_hz
    single, whole = the(found, "values_missing").values, the(found, "frequencies_missing").values
    assert (single["count"], single["pairs"], single["frequencies_hz"]) == (1, [PAIRS[1]], [[f[4]]])
    assert (whole["count"], whole["frequencies_hz"]) == (1, [f[7]])
    golden.holds("\n".join(found.notes))


def test_a_pair_that_is_nowhere_is_told():
    table = response(np.linspace(5.0, 1500.0, 60))
    table["response"][:, 1] = np.nan
    found = FrequencyResponse.from_arrays(**table, rig=RIG)
    assert dict(the(found, "pairs_missing").values) == {"count": 1, "more": None, "pairs": [PAIRS[1]]}


def test_a_whole_response_has_no_such_note():
    assert FrequencyResponse.from_arrays(**response(np.linspace(5.0, 1500.0, 60)), rig=RIG).findings == ()


def test_missing_values_are_compared_without_a_warning():
    found = FrequencyResponse.from_arrays(**with_gaps(), rig=RIG)
    with catch_warnings():
        simplefilter("error")
        comparison = ambid.compare(RIG, found)
        matrix = ambid.misfit_matrix(comparison)[0]
    assert np.isfinite(matrix.power).any()
    assert "values_missing" in [own["code"] for own in comparison.to_json()["records"][0]["findings"]]


def test_magnitudes_without_their_phase_are_refused(golden):
    table = response(np.linspace(5.0, 1500.0, 60))
    table["response"] = np.abs(table["response"])
    with golden.raises(RecordError):
        FrequencyResponse.from_arrays(**table, rig=RIG, name="frf")
