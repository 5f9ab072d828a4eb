"""A session on a mass on one axis: each step does what the public function does, and none changes another."""

import runpy
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import ambid
from ambid.errors import ModelError, RecordError, UnstableLoopError
from ambid.workbench import Bench, Session, as_model_file, as_python, as_report
from hidden.one_axis import ONE_AXIS


def test_it_begins_with_the_rig_as_it_stands(begun):
    alone = ambid.compare(begun.bench.start, begun.bench.records)
    assert begun.comparison.misfit == alone.misfit
    assert begun.did == "start"


def test_an_unstable_start_is_fitted_first(begun, fitted):
    unstable = begun.bench.start.with_values({"K_s.A_zeta": 6.0 * begun.model.theta[1]})
    session = Session.begin(Bench(unstable, begun.bench.records))
    assert not unstable.is_stable
    assert session.estimate is not None
    assert session.comparison.misfit == pytest.approx(fitted.comparison.misfit, rel=1e-3)
    assert session.validation_misfit is None


def test_a_fit_is_that_of_identify(begun, fitted):
    alone = ambid.identify(begun.model, begun.bench.records)
    np.testing.assert_array_equal(fitted.model.theta, alone.model.theta)
    assert fitted.comparison.misfit < begun.comparison.misfit


def test_adding_what_is_hidden_takes_the_misfit_to_noise_on_both_records(fitted, added):
    assert fitted.comparison.misfit > 2.0
    assert added.comparison.is_adequate
    assert added.validation_misfit < added.kept_back.bound < fitted.validation_misfit
    assert added.predicted_misfit == fitted.ranked().ranking.find("loop_delay").predicted_misfit


def test_taking_it_out_again_gives_the_fit_without_it(fitted, added):
    assert added.remove("loop_delay").comparison.misfit == pytest.approx(fitted.comparison.misfit, rel=1e-4)


def test_undo_gives_the_very_step_before(begun, fitted, added, golden):
    assert added.undo() is added.before
    assert fitted.undo() is begun
    with golden.raises(ModelError):
        begun.undo()


def test_a_step_cannot_be_changed(fitted):
    with pytest.raises(FrozenInstanceError):
        fitted.did = "something else"


def test_a_value_set_by_hand_raises_the_misfit_and_is_not_a_fit(added, golden):
    moved = added.move("loop_delay.delay", 2.0 * added.model.theta[-1])
    assert moved.comparison.misfit > 2.0 * added.comparison.misfit
    assert moved.validation_misfit > added.validation_misfit
    assert moved.fitted is added.estimate
    with golden.raises(ModelError):
        moved.ranked()


@pytest.mark.parametrize(
    ("click", "error"),
    [
        pytest.param(lambda begun, added: begun.add("loop_delay"), ModelError, id="before a fit"),
        pytest.param(lambda begun, added: added.remove("sensor_lag"), ModelError, id="not there"),
        pytest.param(lambda begun, added: added.move("K_s", 1e6), ModelError, id="no parameter"),
        pytest.param(lambda begun, added: added.move("loop_delay.delay", -1.0), ModelError, id="not allowed"),
        pytest.param(lambda begun, added: added.move(added.model.names[1], 1e8), UnstableLoopError, id="unstable"),
    ],
)
def test_what_cannot_be_done_is_refused(begun, added, click, error, golden):
    with golden.raises(error):
        click(begun, added)


@pytest.mark.parametrize("name", ["seal_of_solomon", "loop_delay"])
def test_what_is_no_candidate_is_named(added, name):
    with pytest.raises(ModelError, match=f"^{name}: "):
        added.add(name)


def test_records_whose_noise_is_not_known_are_refused(begun, golden):
    (train,) = begun.bench.records
    silent = begun.bench.start.simulate(train.i_e)
    with golden.raises(RecordError):
        Session.begin(Bench(begun.bench.start, (silent,)))


@pytest.fixture(scope="module")
def from_files(tmp_path_factory, begun):
    folder = tmp_path_factory.mktemp("it's a folder")
    rig = ambid.Rig.load(ONE_AXIS.rig.path)
    (train,), (kept,) = begun.bench.records, begun.bench.validate
    read = []
    for name, own in (("train", train), ("kept", kept)):
        own.save(folder / f"{name}.mat")
        read.append(ambid.load_measurement(folder / f"{name}.mat", rig))
    return Session.begin(Bench(ambid.Model(rig), (read[0],), (read[1],)))


@pytest.mark.slow
def test_the_script_gives_the_same_numbers(from_files, tmp_path, capsys):
    session = from_files.fit().add("loop_delay")
    session = session.move("loop_delay.delay", 0.9 * session.model.theta[-1]).fit().remove("loop_delay")
    (tmp_path / "done.py").write_text(as_python(session))
    runpy.run_path(str(tmp_path / "done.py"))
    printed = capsys.readouterr().out.splitlines()
    expected = [
        f"{own.did:32s} misfit {own.comparison.misfit:.9g}  validation {own.validation_misfit:.9g}"
        for own in session.chain
    ]
    assert printed == expected


def test_the_model_file_is_read_again(added, tmp_path):
    (tmp_path / "model.json").write_bytes(as_model_file(added))
    np.testing.assert_array_equal(ambid.Model.load(tmp_path / "model.json").theta, added.model.theta)


@pytest.mark.slow
def test_the_report_tells_of_what_was_added(added, undrawn):
    page = as_report(added).decode()
    assert "loop_delay" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
