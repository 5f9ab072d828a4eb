"""Pole map and Campbell diagram draw the numbers of their results, and can be distinguished in grey."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import ambid
from ambid.demo import DATA
from ambid.errors import InputError
from ambid.plot import plot_campbell, plot_poles, save_campbell, save_poles
from places import LEVITATOR


@pytest.fixture(scope="module")
def known():
    model = ambid.Model(ambid.Rig.load(LEVITATOR))
    return model.with_covariance(np.diag((0.05 * model.theta) ** 2))


@pytest.fixture(scope="module")
def turning():
    rig = ambid.Rig.load(DATA / "rig.toml")
    return ambid.campbell(ambid.Model(rig, points=[rig.replace(speed=500.0)]), np.linspace(0.0, 600.0, 13))


def labelled(ax):
    return {line.get_label(): line for line in ax.lines if not line.get_label().startswith("_")}


def test_poles_are_drawn_before_and_after_with_their_regions(known):
    found = ambid.pole_map(known)
    before = ambid.pole_map(known.with_values({"tau_e": 1e-4}))
    ax = found.plot(before)
    lines = labelled(ax)
    for label, poles in (
        ("closed loop, after", found.closed),
        ("closed loop, before", before.closed),
        ("plant, the controller off", found.open),
    ):
        drawn = 2.0 * np.pi * (lines[label].get_xdata() + 1j * lines[label].get_ydata())
        np.testing.assert_allclose(drawn, poles)
    assert len({line.get_marker() for line in lines.values()}) == 3
    regions = [patch for patch in ax.patches if len(patch.get_xy()) > 100]
    assert len(regions) == len(found.closed)
    low, high = ax.get_xlim()
    assert low < found.closed.real.min() / (2.0 * np.pi)
    assert found.open.real.max() / (2.0 * np.pi) < high


def test_a_region_holds_what_the_covariance_says(known):
    found = ambid.pole_map(known)
    k = int(np.argmax(found.frequency_hz))
    region = [patch for patch in plot_poles(found).patches if len(patch.get_xy()) > 100][k]
    x, y = 2.0 * np.pi * region.get_xy().T - np.array([[found.closed[k].real], [found.closed[k].imag]])
    size = np.einsum("ik,ij,jk->k", [x, y], np.linalg.inv(found.covariance[k]), [x, y])
    np.testing.assert_allclose(size, 5.991, rtol=1e-3)


def test_a_model_without_covariance_has_no_regions(known):
    ax = plot_poles(ambid.pole_map(ambid.Model(known.rig)), ax=Figure().subplots())
    assert not [patch for patch in ax.patches if len(patch.get_xy()) > 100]


def test_branches_rotation_critical_speeds_and_what_was_identified_are_drawn(turning):
    ax = plot_campbell(turning, Figure().subplots())
    lines = [line for line in ax.lines if len(line.get_xdata()) == len(turning.speed)]
    assert len(lines) == turning.frequency_hz.shape[1] + 1
    for line, frequency in zip(lines, turning.frequency_hz.T, strict=False):
        np.testing.assert_allclose(line.get_ydata(), frequency)
        np.testing.assert_allclose(line.get_xdata(), turning.speed * 30.0 / np.pi)
    styles = {str(line.get_linestyle()) for line in lines}
    assert len(styles) >= 3
    rings = [line for line in ax.lines if line.get_label() == "critical speed"]
    assert len(rings) == len(turning.critical)
    assert len(ax.containers) == len(turning.measured)
    assert {"forward", "backward"} <= set(turning.whirls)
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert len(texts) == len(set(texts))


def test_pictures_are_saved_in_formats_that_are_known(known, turning, tmp_path, golden):
    for save, found in ((save_poles, ambid.pole_map(known)), (save_campbell, turning)):
        assert save(found, tmp_path / "drawn.svg").stat().st_size > 5000
        with golden.raises(InputError):
            save(found, tmp_path / "drawn.bmp")
