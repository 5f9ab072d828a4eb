"""The misfit input by output: what is hidden shows in its cells with its signs, and nothing where nothing is."""

import json
from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.errors import RecordError
from hidden.bench import measured
from hidden.families import BENCHES
from hidden.sizes import sized
from tiers import first_fast
from virtual import AXES

BENCH = BENCHES["bench"]


def hidden_seal():
    seal, rig = sized("seal_forces", "large"), BENCH.known_to(("seal_forces",))
    i_e = ambid.prbs(11, amplitude=seal.amplitude, hold=2, axes=4, periods=4)
    record = measured(rig, i_e, {"seal_forces": seal.parameters}, seed=1, **BENCH.truth)
    return ambid.identify(rig, record)


@pytest.fixture(scope="module")
def sealed():
    return hidden_seal()


def test_a_seal_is_answered_crosswise_with_opposite_sign(sealed):
    (matrix,) = ambid.misfit_matrix(sealed.comparison)
    y = matrix.outputs.index
    signs = [
        (matrix.sign[:, y(f"y.{b}_zeta"), y(f"y.{b}_eta")], matrix.sign[:, y(f"y.{b}_eta"), y(f"y.{b}_zeta")])
        for b in "AB"
    ]
    for first, second in signs:
        both = (first != 0) & (second != 0)
        assert both.any()
        assert (first[both] == -second[both]).all()
    assert set(matrix.crossed) == {"A", "B"}
    assert all(correlation < -0.9 for correlation in matrix.crossed.values())


def test_with_the_seal_in_the_model_no_cell_is_told(sealed):
    record = sealed.records[0]
    with_seal = ambid.identify(sealed.model.add("seal_forces"), record)
    (matrix,) = ambid.misfit_matrix(with_seal.comparison)
    assert not matrix.is_told.any()
    assert not matrix.sign.any()
    assert matrix.lines() == []
    assert np.all(matrix.rest < 3.0)


def test_nothing_hidden_is_told_of_no_seed(bench, i_e):
    records = bench.records(i_e, range(4), period=510)
    model = ambid.Model(bench.rig())
    assert not any(own.is_told.any() for r in records for own in ambid.misfit_matrix(ambid.compare(model, r)))


def test_a_wrong_current_is_that_of_its_own_excitation(bench, run):
    record = replace(run, i_c=run.i_c * np.array([1.0, 1.0, 1.1, 1.0]))
    (matrix,) = ambid.misfit_matrix(ambid.compare(ambid.Model(bench.rig()), record))
    _, outputs, _ = np.nonzero(matrix.is_told)
    assert {matrix.outputs[o] for o in outputs} == {"i_c.B_zeta"}
    b, _, i = np.unravel_index(np.nanargmax(matrix.power), matrix.power.shape)
    assert matrix.inputs[i] == "i_e.B_zeta"
    missing = matrix.response[b, matrix.outputs.index("i_c.B_zeta"), i]
    assert missing.real > 0.0
    assert abs(missing.imag) < 0.5 * missing.real


def test_the_missing_response_is_that_of_the_model_with_the_effect(sealed):
    (matrix,) = ambid.misfit_matrix(sealed.comparison)
    with_seal = ambid.identify(sealed.model.add("seal_forces"), sealed.records[0]).model
    band, o, i = 1, matrix.outputs.index("y.A_zeta"), matrix.inputs.index("i_e.A_eta")
    middle = np.linspace(*matrix.edges_hz[band : band + 2], 50)
    apart = [
        model.loop.transfer(model.theta, np.exp(2j * np.pi * middle * model.loop.sample_time))[:, o, i].mean()
        for model in (with_seal, sealed.model)
    ]
    expected = apart[0] - apart[1]
    assert abs(matrix.response[band, o, i] - expected) < 0.35 * abs(expected)


def test_one_sequence_on_two_axes_is_not_told_apart(bench, i_e):
    same = i_e[:, [0, 0, 2, 3]]
    (record,) = bench.records(same, [1], period=510)
    wrong = ambid.Model(bench.rig()).with_values({"K_i.A_eta": 180.0})
    (matrix,) = ambid.misfit_matrix(ambid.compare(wrong, record))
    assert np.isnan(matrix.power[:, :, :2]).all()
    assert np.isfinite(matrix.power[:, :, 2:]).all()
    assert not matrix.is_told[:, :, :2].any()
    assert {tuple(own.values["inputs"]) for own in matrix.findings} == {("i_e.A_zeta", "i_e.A_eta")}
    assert all(note in matrix.lines() for note in matrix.notes)


def test_one_axis_after_the_other_has_a_column_each(bench, i_e):
    alone = i_e * np.array([1.0, 0.0, 0.0, 0.0])
    (record,) = bench.records(alone, [1], period=510)
    (matrix,) = ambid.misfit_matrix(ambid.compare(ambid.Model(bench.rig()), record))
    assert matrix.inputs == ("i_e.A_zeta",)
    assert len(matrix.edges_hz) - 1 == len(matrix.power)


@pytest.mark.parametrize("kind", first_fast(["response", "without periods"]))
def test_a_frequency_response_and_a_record_without_periods(sealed, kind):
    record = sealed.records[0]
    other = record.frequency_response() if kind == "response" else replace(record, period=None)
    (matrix,) = ambid.misfit_matrix(ambid.compare(sealed.model, other))
    assert matrix.inputs == tuple(f"i_e.{axis}" for axis in AXES)
    assert all(correlation < -0.8 for correlation in matrix.crossed.values())


def test_a_record_without_noise_is_refused(bench, run):
    brief = {signal: getattr(run, signal)[:40] for signal in ("i_e", "y", "i_c")}
    comparison = ambid.compare(ambid.Model(bench.rig()), replace(run, **brief, period=None))
    with pytest.raises(RecordError):
        ambid.misfit_matrix(comparison)


def test_its_lines_are_readable(sealed, golden):
    (matrix,) = ambid.misfit_matrix(sealed.comparison)
    golden.holds("\n".join(matrix.lines(most=2)))


def test_it_is_plain_data(sealed):
    (matrix,) = ambid.misfit_matrix(sealed.comparison)
    shown = json.loads(json.dumps(matrix.to_json(), allow_nan=False))
    assert np.shape(shown["power"]) == np.shape(shown["sign"]) == matrix.power.shape
    assert np.shape(shown["response"]) == (*matrix.power.shape, 2)
    assert shown["crossed"]["A"] == pytest.approx(matrix.crossed["A"])
