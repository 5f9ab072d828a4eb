"""What the page gets over frequency is what the public functions return of the same model."""

from dataclasses import replace

import numpy as np
import pytest

import ambid
from ambid.errors import ModelError
from ambid.excitation import prbs
from ambid.workbench import Bench, Session, frequency_views
from ambid.workbench.views import LEVELS
from places import SHARED

SEAL = SHARED / "cases" / "06-seal"
Y, BY = "y.A_zeta", "i_e.A_zeta"


def test_a_response_is_that_of_the_record_with_its_noise(added):
    shown = frequency_views.responses(added, 0, Y, BY, 4000)
    measured = added.bench.records[0].frequency_response()
    size, std = np.abs(measured.response[:, 0, 0]), measured.std[:, 0, 0]
    assert (shown["unit"], shown["input"], shown["why_not"]) == ("µm/A", BY, "")
    np.testing.assert_allclose(shown["frequency_hz"], measured.frequency_hz)
    np.testing.assert_allclose(shown["size"], 1e6 * size)
    np.testing.assert_allclose(shown["high"], 1e6 * (size + 2.0 * std))
    np.testing.assert_allclose(shown["noise"], 1e6 * std)


def test_the_model_before_the_step_stands_beside_that_of_now(added):
    shown = frequency_views.responses(added, 0, Y, BY, 4000)
    now, before = shown["models"]
    assert (now["name"], before["name"]) == ("now (+ loop_delay)", "before (fit)")
    noise = np.array(shown["noise"])
    left_now, left_before = (np.mean((np.array(own["left"]) / noise) ** 2) for own in (now, before))
    assert left_now < 1.5
    assert left_before > 3.0


def test_the_first_step_has_no_model_before_it(begun):
    assert len(frequency_views.responses(begun, 0, Y, None, 500)["models"]) == 1


def test_a_record_to_validate_on_has_responses_too(added):
    kept = added.bench.validate[0]
    shown = frequency_views.responses(added, 1, Y, BY, 4000)
    np.testing.assert_allclose(shown["size"], 1e6 * np.abs(kept.frequency_response().response[:, 0, 0]))


def test_a_phase_lost_in_the_noise_is_not_told(added):
    shown = frequency_views.responses(added, 0, Y, BY, 4000)
    for size, noise, phase in zip(shown["size"], shown["noise"], shown["phase"], strict=True):
        assert (phase is None) == (size <= 2.0 * noise)


def test_what_has_no_response_says_why(begun, golden):
    golden.holds(frequency_views.responses(begun, 0, Y, "i_e.B_eta", 500)["why_not"])
    model = begun.bench.start
    short = replace(model.virtual_experiment(prbs(5, amplitude=1.0, hold=1, axes=1, periods=8), seed=1), period=31)
    session = Session.begin(Bench(model, begun.bench.records, (short,)))
    golden.holds(frequency_views.responses(session, 1, Y, None, 500)["why_not"])


def test_a_prediction_is_that_of_predict(fitted):
    found = ambid.predict(fitted.ranking, "loop_delay")
    shown = frequency_views.prediction(fitted, 0, Y, "loop_delay")
    now, then = found.curves[0]
    known = np.isfinite(now.misfit[:, 0])
    np.testing.assert_allclose(shown["now"], now.misfit[known, 0])
    np.testing.assert_allclose(shown["then"], then.misfit[known, 0])
    assert shown["lines"][0] == found.lines()[0]


def test_without_a_ranking_nothing_is_predicted(begun, golden):
    with golden.raises(ModelError):
        frequency_views.prediction(begun, 0, Y, "loop_delay")


def test_the_matrix_is_that_of_misfit_matrix(fitted):
    train, kept = frequency_views.matrices(fitted)
    (found,) = ambid.misfit_matrix(fitted.comparison)
    assert (train["index"], kept["index"]) == (0, 1)
    for b, band in enumerate(train["bands"]):
        assert (band["low"], band["high"]) == tuple(found.edges_hz[b : b + 2])
        for o, row in enumerate(band["rows"]):
            for i, cell in enumerate(row):
                assert (cell["level"] > 0) == bool(found.is_told[b, o, i])
                assert cell["text"][:1] in {1: "+", -1: "−", 0: "0123456789"}[found.sign[b, o, i]] or not cell["text"]
                assert cell["level"] <= len(LEVELS)


def test_of_a_model_that_is_right_no_cell_is_told(added):
    cells = [cell for band in frequency_views.matrices(added)[0]["bands"] for row in band["rows"] for cell in row]
    assert {(cell["text"], cell["level"]) for cell in cells} == {("", 0)}
    assert len({cell["words"] for cell in cells}) == 1


@pytest.mark.skipif(not SEAL.exists(), reason="the measured cases are not here")
def test_a_seal_shows_as_opposite_signs_of_the_two_axes():
    rig = ambid.Rig.load(SEAL / "rig.toml").exact()
    session = Session.begin(Bench(ambid.Model(rig), (ambid.Record.load(SEAL / "train.mat", rig),))).fit()
    (shown,) = frequency_views.matrices(session)
    rows = {name: k for k, name in enumerate(shown["outputs"])}
    columns = {name: k for k, name in enumerate(shown["inputs"])}
    opposite = 0
    for band in shown["bands"]:
        one = band["rows"][rows["y.A_zeta"]][columns["i_e.A_eta"]]["text"][:1]
        other = band["rows"][rows["y.A_eta"]][columns["i_e.A_zeta"]]["text"][:1]
        opposite += {one, other} == {"+", "−"}
        assert one != other or one not in ("+", "−")
    assert opposite >= 2
