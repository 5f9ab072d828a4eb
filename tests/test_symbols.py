"""Symbols are set alike on a page, in a picture and in LaTeX, and names of files stay as they are."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from ambid.plot.style import new_figure
from ambid.symbols import in_latex, in_page, in_picture


def test_on_a_page_they_are_set_in_text_alone():
    found = in_page('<title>K_i</title><p title="K_s">K_i.A_zeta, tau_e, i_ref, i_el <code>i_e.x</code></p>')
    assert found == (
        '<title>K_i</title><p title="K_s">K<sub>i</sub>.A_zeta, τ<sub>e</sub>, i<sub>ref</sub>, i_el '
        "<code>i_e.x</code></p>"
    )


def test_in_latex_the_rest_is_escaped():
    assert in_latex("tau_e, K_s.A_zeta of run_K_i: 5 %") == r"$\tau_{e}$, $K_{s}$.A\_zeta of run\_K\_i: 5 \%"


def test_in_a_picture_a_dollar_begins_no_formula():
    assert in_picture("cost $1 of $2") == ("cost $1 of $2", False)
    assert in_picture("K_i of $a$") == (r"$\mathregular{K_{i}}$ of \$a\$", True)


def pixels(figure: Figure, text: str, tick: str):
    ax = figure.subplots()
    ax.set_title(text)
    ax.set_yticks([0], [tick])
    stream = io.BytesIO()
    for _ in range(2):  # a second drawing is as the first
        stream.seek(0)
        figure.savefig(stream, format="png", dpi=100)
    stream.seek(0)
    return imread(stream)


@pytest.mark.parametrize(
    ("written", "formula"),
    [("tau_e", r"$\mathregular{τ_{e}}$"), ("x$y$ K_s.B", r"x\$y\$ $\mathregular{K_{s}}$.B"), ("a_b 5$", "a_b 5$")],
)
def test_figures_set_titles_and_labels_of_ticks(written, formula):
    expected = pixels(Figure(figsize=(4, 2), layout="constrained"), formula, formula)
    np.testing.assert_array_equal(pixels(new_figure(4, 2), written, written), expected)
