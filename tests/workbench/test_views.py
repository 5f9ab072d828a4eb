"""What the page gets, where a record is no plain one: frequency responses, and other operating points."""

import json
import runpy

import numpy as np
import pytest

import ambid
from ambid.errors import InputError
from ambid.findings import worst_first
from ambid.workbench import Bench, Session, as_python, frequency_views, views
from hidden.one_axis import ONE_AXIS


@pytest.fixture(scope="module")
def of_response(begun):
    (train,) = begun.bench.records
    return Session.begin(Bench(begun.bench.start, (train.frequency_response(),)))


def test_a_frequency_response_is_shown_over_frequency(of_response):
    (response,) = of_response.bench.records
    found = views.signals(of_response, 0, "y.A_zeta", None, 4000)
    assert found["x_unit"] == "Hz"
    np.testing.assert_allclose(found["x"], response.frequency_hz)
    np.testing.assert_allclose(found["measured"], np.abs(response.response[:, 0, 0]))
    np.testing.assert_allclose(found["noise"], response.std[:, 0, 0])


def test_all_that_is_told_is_strict_json(begun, added, of_response):
    for session in (begun, added.ranked(), of_response, of_response.fit().ranked()):
        channel = session.comparison.records[0].channels[0].channel
        for shown in (
            views.overview(session),
            views.candidates(session),
            views.where(session),
            frequency_views.lines(session, 0, channel, 500),
            frequency_views.responses(session, 0, channel, None, 500),
            frequency_views.matrices(session),
            views.signals(session, 0, channel, None, 500),
        ):
            assert json.dumps(shown, allow_nan=False)


def test_a_band_without_a_line_is_not_drawn_as_the_worst(begun, of_response):
    (response,) = of_response.bench.records
    rare = response.frequency_hz > 30.0
    rare[:2] = True  # two low lines, and nothing between them and the rest
    kept = [own[rare] for own in (response.frequency_hz, response.response, response.std)]
    few = ambid.FrequencyResponse("few", *kept, response.outputs, response.inputs)
    session = Session.begin(Bench(begun.bench.start, (few,)))
    cells = [cell for row in views.where(session)["maps"][0]["cells"] for cell in row]
    silent = [cell for cell in cells if cell["misfit"] is None]
    assert silent
    assert {(cell["text"], cell["level"]) for cell in silent} == {("", 0)}


def test_candidates_stand_between_noise_and_now(fitted):
    rows = views.candidates(fitted)["candidates"]
    predicted, left = np.array([[row["predicted_misfit"], row["left"]] for row in rows]).T
    assert ((left >= 0.0) & (left <= 1.0)).all()
    assert (np.diff(left[np.argsort(predicted)]) >= 0.0).all()


def test_a_chance_too_small_for_a_number_is_not_printed_as_one(fitted):
    chances = {row["effect"]: row["chance"] for row in views.candidates(fitted)["candidates"]}
    for own in fitted.ranking.candidates:
        assert (chances[own.effect.name] == "< 1e-300") == (own.p_value < 1e-299)


def test_the_ends_of_a_slider_hold_its_value_and_what_physics_allows(added):
    for shown, own in zip(views.overview(added)["parameters"], added.model.parameters, strict=True):
        assert own.lower <= shown["low"] <= shown["value"] <= shown["high"] <= own.upper


def test_a_parameter_says_by_how_many_standard_errors_it_moved(fitted, added):
    shown = next(own for own in views.overview(added)["parameters"] if own["name"] == "tau_e")
    was, now = fitted.estimate.parameters["tau_e"].value, added.estimate.parameters["tau_e"]
    assert shown["moved_by_std_errors"] == pytest.approx((now.value - was) / now.std_error)


def test_findings_are_told_worst_first_and_in_words(begun, fitted):
    of_records = [finding for own in begun.comparison.records for finding in own.findings]
    for session, own in ((begun, of_records), (fitted, fitted.estimate.findings)):
        for shown in (views.overview(session), views.held(session)):
            assert shown["findings"] == [finding.as_dict() for finding in worst_first(own)]
            assert shown["notes"] == [finding.line() for finding in worst_first(own)]
    assert views.overview(fitted)["findings"]


def test_a_window_beyond_the_record_is_moved_into_it(fitted, golden):
    record = fitted.comparison.records[0].record
    found = views.signals(fitted, 0, record.channels[0], (1e6, 2e6), 500)
    assert found["x"][-1] == pytest.approx(record.t[-1])
    with golden.raises(InputError):
        views.signals(fitted, 2, record.channels[0], None, 500)


def test_the_script_opens_other_operating_points_too(tmp_path, capsys):
    fast = tmp_path / "fast.toml"
    fast.write_text(ONE_AXIS.rig.path.read_text().replace("bias_current = 4.0", "bias_current = 3.8"))
    here, there = ambid.Rig.load(ONE_AXIS.rig.path), ambid.Rig.load(fast)
    assert here != there
    records = []
    for k, rig in enumerate((here, there)):
        i_e = ONE_AXIS.excitation(1.0)
        ambid.Model(here).virtual_experiment(i_e, seed=k).save(tmp_path / f"{k}.mat")
        record = ambid.load_measurement(tmp_path / f"{k}.mat", rig)
        records.append(record if rig is here else record.at(rig))
    session = Session.begin(Bench(ambid.Model(here), tuple(records))).fit()
    (tmp_path / "done.py").write_text(as_python(session))
    runpy.run_path(str(tmp_path / "done.py"))
    printed = capsys.readouterr().out.splitlines()
    assert printed == [f"{own.did:32s} misfit {own.comparison.misfit:.9g}" for own in session.chain]


def test_a_slider_neither_fits_nor_estimates_noise_again(fitted, monkeypatch):
    """So that it costs no more than the residual of one model."""
    for name in ("identify", "compare", "rank", "localise"):
        monkeypatch.setattr(f"ambid.workbench.session.{name}", None)
    moved = fitted.move("K_i.A_zeta", 1.01 * fitted.model.theta[0])
    assert views.misfits(moved)["misfit"] > views.misfits(fitted)["misfit"]
    assert moved.comparison.noise is fitted.comparison.noise
