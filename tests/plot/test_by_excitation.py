"""Pictures of frequency responses and of the misfit input by output hold the numbers that they are made of."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import ambid
from ambid.diagnosis import MisfitMatrix
from ambid.errors import InputError
from ambid.plot import draw_responses, plot_frequency_response, plot_misfit_matrix, save_responses
from places import LEVITATOR
from plot.texts import texts_of


@pytest.fixture(scope="module")
def comparison(bench, run):
    return ambid.compare(ambid.Model(bench.rig()), run)


def matrix():
    power = np.array([[[400.0, 0.5], [90.0, np.nan]]])
    response, shown = np.array([[[2e-6 + 0j, 0], [-3e-6, np.nan]]]), np.array([[[True, False], [True, False]]])
    std, rest = np.full(power.shape, 1e-7), np.array([[1.0, 12.0]])
    names = ("y.A_zeta", "y.A_eta"), ("i_e.A_zeta", "i_e.A_eta")
    return MisfitMatrix("run", *names, np.array([2.0, 50.0]), power, response, std, shown, rest)


def test_size_phase_and_what_is_left_have_panels(comparison, golden):
    before = comparison.model.with_values({"K_i.B_eta": 200.0})
    size, phase, left = comparison.plot_frequency_response("y.B_eta", "i_e.B_eta", before=before)
    shown = ambid.frequency_responses(comparison, before=[before])
    o, i = shown.place("y.B_eta", "i_e.B_eta")
    lines = {line.get_label(): line for line in size.lines}
    np.testing.assert_allclose(lines["base model"].get_ydata()[5], np.abs(shown.modelled[-1].response[5, o, i]))
    assert len(left.lines) == 3
    np.testing.assert_allclose(left.lines[0].get_ydata(), shown.measured.std[:, o, i])
    golden.holds(texts_of(size, phase, left))


def test_models_differ_without_colour(comparison):
    before = comparison.model.with_values({"K_i.B_eta": 200.0})
    size, *_ = plot_frequency_response(comparison, "y.B_eta", "i_e.B_eta", before=before)
    drawn = [line for line in size.lines if line.get_label() == "base model"]
    assert {line.is_dashed() for line in drawn} == {True, False}


def test_the_axes_that_are_given_are_used_and_two_leave_the_phase_out(comparison, golden):
    three, two = Figure().subplots(3, 1), Figure().subplots(2, 1)
    assert list(plot_frequency_response(comparison, ax=three)) == list(three)
    assert list(plot_frequency_response(comparison, ax=two)) == list(two)
    with golden.raises(InputError):
        plot_frequency_response(comparison, "y.C_zeta", "i_e.A_zeta")


@pytest.mark.slow
def test_all_pairs_are_drawn(comparison):
    assert len(draw_responses(ambid.frequency_responses(comparison)).axes) == 2 * 8 * 4


def test_all_pairs_are_saved(tmp_path, golden):
    model = ambid.Model(ambid.Rig.load(LEVITATOR))
    record = model.virtual_experiment(ambid.prbs(8, amplitude=0.3, hold=2, axes=1, periods=4), seed=1)
    shown = ambid.frequency_responses(ambid.compare(model, record))
    saved = save_responses(shown, tmp_path / "frf.png")
    assert saved.stat().st_size > 10_000
    with golden.raises(InputError):
        save_responses(shown, tmp_path / "frf.gif")


def test_cells_hold_power_and_sign_and_those_that_say_nothing_are_empty(golden):
    (panel,) = plot_misfit_matrix(matrix())
    assert [text.get_text() for text in panel.texts] == ["+400", "−90", "12"]
    assert [label.get_text() for label in panel.get_xticklabels()] == ["A_zeta", "A_eta", "none"]
    assert panel.get_title(loc="left") == "2 – 50 Hz"
    with golden.raises(InputError):
        plot_misfit_matrix(matrix(), ax=[])
