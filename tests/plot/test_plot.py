"""Pictures draw the numbers that they are given, on the axes that they are given."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import ambid
from ambid.diagnosis import Candidate, Localisation, Ranking, compare
from ambid.diagnosis.localisation import Growth, MisfitMap
from ambid.diagnosis.ports import Port
from ambid.effects import find
from ambid.errors import InputError
from ambid.noise.shapes import Term
from ambid.plot import (
    plot_comparison,
    plot_growth,
    plot_misfit_map,
    plot_needed,
    plot_ranking,
    plot_sensitivity,
    plot_staircase,
    save_comparison,
    worst_stretch,
)
from ambid.plot.style import GUIDE, shown_in
from places import LEVITATOR
from plot.texts import texts_of


@pytest.fixture(scope="module")
def comparison(demo_estimate, demo_record):
    return compare(demo_estimate.model, demo_record)


def axes(rows=1, columns=1):
    return Figure().subplots(rows, columns, squeeze=False).ravel()


def candidate(name, score, degrees, confusable=(), **more):
    return Candidate(find(name), score, degrees, {}, 1.0 + 1.0 / score, tuple(confusable), **more)


def ranking():
    first = candidate("loop_delay", 1000.0, 1, ["sensor_lag"])
    found = (first, candidate("sensor_lag", 900.0, 1, ["loop_delay"]), candidate("back_emf", 2.0, 1))
    return Ranking(found, 5.0, {})


def localisation(**changes):
    rng = np.random.default_rng(1)
    s = 1e-5 * rng.standard_normal((1000, 2))
    against = {"s": s, "v": 1e3 * s[::-1], "i_f": rng.standard_normal((1000, 2)), "i_ref": s, "y": s}
    against |= {"s_other": s[:, ::-1], "v_other": 1e3 * s[::-1, ::-1]}
    term = Term("s^3", "odd", np.array([1e15, 1e15]), 500.0, 0.95, -250.0)
    port = Port("force", "N", "force at the magnets", 1.0, 2000, 1e15 * s**3, against, (term,), lambda *_: None)
    table = np.array([[200.0, 3000.0], [np.nan, 50.0], [1.0, 1.2]])
    own = MisfitMap("train", ("y.A_zeta", "y.A_eta"), np.array([10.0, 100.0, 1000.0, 5000.0]), 10.0, table)
    growth = (Growth("small", 0.5, 1e-8), Growth("large", 1.0, 8e-8))
    given = {
        "maps": (own,),
        "ports": (port,),
        "tones": (),
        "changes": (),
        "growth": growth,
        "exponent": 3.0,
        "cells": (),
    }
    return Localisation(**given | changes)


def test_signals_are_those_of_the_record_and_the_model(comparison, golden):
    one = comparison.records[0]
    above, below = plot_comparison(comparison, 0, "y.A_eta", stretch=(0.5, 0.54))
    k, span = 1, slice(5000, 5400)
    measured, simulated = (line.get_ydata() for line in above.lines)
    residual = below.lines[0].get_ydata()
    np.testing.assert_allclose(measured - simulated, residual, atol=1e-9)
    np.testing.assert_allclose(residual, 1e6 * one.residual[span, k])
    np.testing.assert_allclose(np.diff(measured), 1e6 * np.diff(one.record.y[span, k]), atol=1e-9)
    band = below.patches[0]
    assert band.get_height() == pytest.approx(4e6 * one.channels[k].noise_rms)
    golden.holds(texts_of(above, below))


def test_before_and_after_share_a_scale_and_large_currents_are_amperes(comparison, golden):
    wrong = comparison.model.with_values({"K_i.A_zeta": 250.0})
    above, below = plot_comparison(comparison, 0, "i_c.A_zeta", before=wrong)
    lines = {line.get_label(): line for line in below.lines}
    before, after = (np.ptp(lines[label].get_ydata()) for label in ("residual before", "residual"))
    assert before > after
    golden.holds(texts_of(above, below))
    assert shown_in("A", 0.9) == (1e3, "mA")
    assert shown_in("A", 1.0) == (1.0, "A")
    with golden.raises(InputError):
        plot_comparison(comparison, stretch=(2.0, 1.0))


def test_a_model_and_a_record_will_do_and_axes_are_used(demo_estimate, demo_record):
    given = axes(2)
    found = plot_comparison((demo_estimate.model, demo_record), ax=given)
    assert list(found) == list(given)
    assert all(ax.lines for ax in given)


def test_the_worst_stretch_holds_the_largest_residual(comparison):
    residual = comparison.records[0].residual[:, 0]
    begin, end = (round(t * 1e4) for t in worst_stretch(comparison, 0, "y.A_zeta"))
    period = comparison.records[0].record.period
    assert period <= begin < end <= 2 * period
    power = np.convolve(residual[period : 2 * period] ** 2, np.ones(end - begin), "valid")
    assert np.sum(residual[begin:end] ** 2) == pytest.approx(power.max())


@pytest.mark.parametrize(("record", "channel"), [(3, None), (0, "y.C_zeta")])
def test_a_wrong_record_or_channel_is_named(comparison, record, channel, golden):
    with golden.raises(InputError):
        plot_comparison(comparison, record, channel)


def test_saved_pictures_and_refused_suffix(comparison, tmp_path, golden):
    assert save_comparison(comparison, tmp_path / "a.png") == [tmp_path / "a.png"]
    with golden.raises(InputError):
        save_comparison(comparison, tmp_path / "a.xyz")


def test_misfit_map_holds_the_table_and_greys_what_chance_may_bring(golden):
    (given,) = axes()
    found = localisation()
    assert plot_misfit_map(found, ax=given) is given
    shown = np.ma.masked_where(~(found.maps[0].misfit > 2.0), found.maps[0].misfit)
    np.testing.assert_array_equal(given.collections[0].get_array(), shown)
    golden.holds("\n".join(text.get_text() for text in given.texts))
    assert len({text.get_color() for text in given.texts[2:3] + given.texts[4:]}) == 1
    assert given.texts[4].get_color() != given.texts[0].get_color()
    assert [label.get_text() for label in given.get_xticklabels()] == ["y.A_zeta", "y.A_eta"]
    assert plot_misfit_map(found.maps, largest=1e6).collections[0].norm.vmax == 1e6
    with golden.raises(InputError):
        plot_misfit_map(found, 1)


def test_ranking_goes_from_now_to_what_each_candidate_predicts():
    (given,) = axes()
    found = ranking()
    assert plot_ranking(found, given) is given
    bars = given.patches
    assert [bar.get_x() + bar.get_width() for bar in bars] == pytest.approx([5.0, 5.0, 5.0])
    assert [bar.get_x() for bar in bars] == pytest.approx([c.predicted_misfit for c in found.candidates])
    dots = [line for line in given.lines if line.get_marker() == "o"]
    assert [dot.get_markerfacecolor() == "white" for dot in dots] == [False, True, False]
    assert bars[2].get_facecolor() != bars[1].get_facecolor()
    assert [label.get_text() for label in given.get_yticklabels()] == ["loop_delay", "sensor_lag", "back_emf"]
    assert {"1.00", "1.50", "100.0 %", "88 %"} <= {text.get_text() for text in given.texts}


def test_a_p_value_that_no_number_holds_is_not_told_as_one():
    large, small = candidate("loop_delay", 1e6, 1), candidate("sensor_lag", 20.0, 1)
    assert large.p_text == "< 1e-300"
    assert float(small.p_text) == pytest.approx(small.p_value, rel=0.1)
    assert "< 1e-300" in str(Ranking((large, small), 5.0, {}))


def test_an_empty_ranking_is_drawn_empty():
    assert not plot_ranking(Ranking((), 1.0, {})).patches


def test_staircase_holds_the_ledger(explained, golden):
    given = axes(1, 2)
    left, right = plot_staircase(explained, given)
    assert [left, right] == list(given)
    train, kept_back, predicted, noise = (list(line.get_ydata()) for line in left.lines)
    assert train == [step.misfit for step in explained.history]
    assert kept_back == [step.validation_misfit for step in explained.history]
    assert predicted == [explained.history[-1].predicted_misfit]
    assert noise == [1.0, 1.0]
    steps = " | ".join(label.get_text() for label in left.get_xticklabels())
    golden.holds(f"{texts_of(left, right)}\n{steps}")
    before = {p.name: p.value for p in explained.history[0].model.parameters}
    assert [label.get_text() for label in right.get_yticklabels()] == list(before)
    moved = [container.lines[0].get_xdata()[0] for container in right.containers]
    now = explained.parameters
    assert moved == pytest.approx([100.0 * (now[name].value / value - 1.0) for name, value in before.items()])
    with golden.raises(InputError):
        plot_staircase(replace(explained, history=[], verdict="not_informative"))


def test_needed_signal_of_a_port_as_means_over_bins():
    given = axes(1, 3)
    port = localisation().ports[0]
    assert list(plot_needed(port, given, axes=["A", "B"])) == list(given)
    lines = {line.get_label(): line for line in given[0].lines}
    x, y = lines["A"].get_data()
    order = np.argsort(port.against["s"][:, 0])
    parts = np.array_split(order, len(x))
    np.testing.assert_allclose(x, [1e6 * port.against["s"][own, 0].mean() for own in parts])
    np.testing.assert_allclose(y, [port.needed[own, 0].mean() for own in parts])
    assert lines["A"].get_marker() != lines["B"].get_marker()
    assert [len(ax.collections) for ax in given] == [1, 1, 1]
    shapes = [[line for line in ax.lines if "s^3" in line.get_label()] for ax in given]
    assert list(map(len, shapes)) == [1, 0, 0]


def test_a_shape_that_explains_less_than_half_is_not_drawn_nor_a_port(golden):
    port = localisation().ports[0]
    weak = replace(port, terms=(replace(port.terms[0], share=0.4),))
    assert not any("s^3" in line.get_label() for line in plot_needed(weak)[0].lines)
    with golden.raises(InputError):
        plot_needed(replace(port, share=0.4))


def test_a_shape_over_the_other_axis_gets_a_panel_of_its_own(golden):
    port = localisation().ports[0]
    other = 3e6 * port.against["s_other"] * np.array([1.0, -1.0])
    term = Term("s of the other axis", "linear", np.array([3e6, -3e6]), 9e3, 0.9, -100.0)
    given = axes(1, 3)
    plot_needed(replace(port, needed=other, terms=(term,)), given)
    golden.holds(texts_of(*given))
    for line in given[2].lines[:2]:
        x, y = line.get_data()
        np.testing.assert_allclose(y, 3e6 * 1e-6 * x)


def test_only_bands_with_something_to_see_are_drawn(golden):
    found = localisation()
    port = found.ports[0]
    spectrum = np.fft.rfft(port.needed, axis=0)
    spectrum[100:501] = 0.0  # from 1000 Hz on the map shows noise alone, and from 100 to 1000 Hz enough
    seen = np.fft.irfft(spectrum, axis=0)
    drawn = plot_needed(found)[0].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, plot_needed(replace(port, needed=seen))[0].lines[0].get_ydata(), atol=1e-9)
    assert np.abs(drawn - plot_needed(port)[0].lines[0].get_ydata()).max() > 1e-3
    with golden.raises(InputError):
        plot_needed(localisation(ports=()))


def test_growth_needs_two_amplitudes(golden):
    (given,) = axes()
    assert plot_growth(localisation(), given) is given
    np.testing.assert_allclose(given.lines[0].get_xydata(), [[0.5, 0.01], [1.0, 0.08]])
    with golden.raises(InputError):
        plot_growth(localisation(exponent=np.nan))


def test_matplotlib_is_loaded_only_for_drawing():
    code = "import sys, ambid, ambid.plot; assert not any(m.startswith('matplotlib') for m in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_sensitivity_is_drawn_with_band_peaks_and_zones():
    model = ambid.Model(ambid.Rig.load(LEVITATOR))
    found = ambid.margins(model.with_covariance(np.diag((0.05 * model.theta) ** 2)), draws=40)
    (ax,) = axes()
    plot_sensitivity(found, ax)
    (curve,) = [line for line in ax.lines if len(line.get_xdata()) == len(found.frequency_hz)]
    np.testing.assert_array_equal(curve.get_ydata(), found.sensitivity[:, 0])
    assert len(ax.collections) == 1
    levels = [line.get_ydata()[0] for line in ax.lines if line.get_color() == GUIDE]
    assert levels == [3.0, 4.0, 5.0]
    assert found.axes[0].sensitivity.value in [line.get_ydata()[0] for line in ax.lines]
    plot_sensitivity(ambid.margins(model), axes()[0])
