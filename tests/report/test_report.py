"""The report tells the story of each verdict in one self-contained file."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import ambid
from ambid.diagnosis import Diagnosis
from ambid.errors import InputError
from ambid.report import numbers, words, write_report
from places import LEVITATOR

VOID = {"meta", "img"}
CHAPTERS = [
    "What to do next",
    "Measured against simulated, before and after",
    "Where the base model fails",
    "Which effect",
    "What adding it did",
    "The shape of what is missing",
    "Parameters of the last model",
    "The machine and the records",
    "Words",
]


class Page(HTMLParser):
    """Text, chapters, sources and balance of the tags of a page."""

    def __init__(self, html):
        super().__init__()
        self.open, self.chapters, self.sources, self.text = [], [], [], []
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        (self.chapters if self.open[-1:] == ["h2"] else self.text).append(data)


@pytest.fixture(scope="module")
def explained():
    rig = ambid.Rig.load(LEVITATOR)
    hidden = ambid.Model(rig).add("loop_delay", {"delay": 5e-5})
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=1, periods=4)
    train, other = (hidden.virtual_experiment(factor * i_e, seed=seed) for factor, seed in ((1.0, 1), (0.5, 2)))
    train, other = (replace(r, name=name, period=2044) for r, name in ((train, "train"), (other, "other")))
    found = ambid.diagnose(rig, train, validate=[other])
    assert found.verdict == "explained"
    assert found.effects == ("loop_delay",)
    return found


def page(diagnosis, folder):
    path = write_report(diagnosis, folder / "report.html")
    html = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 5e6
    assert html.lstrip().startswith("<!DOCTYPE html>")
    assert not re.search(r"https?://|<script|@import|url\(", html)
    assert not re.search(r"\bnan\b|\bNone\b|\binf\b", html)
    found = Page(html)
    assert all(source.startswith("data:image/") for source in found.sources)
    found.all = " ".join(" ".join(found.text).split())
    assert words.plain(diagnosis.verdict) in found.all
    return found


def test_explained_tells_the_whole_story_in_order(explained, tmp_path):
    found = page(explained, tmp_path)
    assert found.chapters == CHAPTERS
    first, last = explained.history[0], explained.history[-1]
    assert f"falls from {words.misfit(first.misfit)} to {words.misfit(last.misfit)}" in found.all
    for figure in (first.fit_percent["average"], last.fit_percent["average"], last.validation_fit_percent["average"]):
        assert words.percent(figure) in found.all
    assert "Loop delay explains" in found.all
    assert "loop_delay.delay" in found.all
    assert explained.next_experiment[1:] in found.all
    assert len(found.sources) == 6


def test_ambiguous_shows_the_set_and_the_next_experiment(explained, tmp_path):
    names = ["loop_delay", "amplifier_bandwidth"]
    found = page(replace(explained, verdict="ambiguous", ambiguous_sets=[names]), tmp_path)
    assert "One of loop delay or amplifier bandwidth explains" in found.all
    assert "These cannot be told apart" in found.all
    assert all(name in found.all for name in names)


def test_none_says_where_and_adds_nothing(explained, tmp_path):
    model = numbers.base_model(explained)
    none = replace(explained, verdict="none_of_the_candidates", effects=(), model=model, history=explained.history[:1])
    found = page(none, tmp_path)
    assert "nothing was added" in found.all
    assert "Where the base model fails" in found.chapters
    assert "What adding it did" not in found.chapters
    assert "Parameters of the base model" in found.chapters


def test_steps_that_led_nowhere_are_said_to_be_taken_back(explained, tmp_path):
    none = replace(explained, verdict="none_of_the_candidates", effects=(), model=numbers.base_model(explained))
    found = page(none, tmp_path)
    assert "led to no explanation and were taken back" in found.all
    assert "explains what the base model missed" not in found.all


def test_adequate_claims_no_failure(explained, tmp_path):
    step = explained.history[-1]
    calm = replace(step, effects=(), added=None, model=numbers.base_model(explained))
    adequate = replace(
        explained, verdict="adequate", effects=(), history=[calm], model=numbers.base_model(explained), notes=()
    )
    found = page(adequate, tmp_path)
    assert "Nothing is missing that these data can show" in found.all
    assert "What would stay invisible" in found.all
    assert "The port" not in found.all
    assert "The shape of what is missing" not in found.chapters


def test_not_informative_says_why_and_what_to_do(explained, tmp_path):
    why = "train: only 2 periods <of> the excitation"
    nothing = Diagnosis.uninformative(explained.model, explained.records, [why], 0.0)
    found = page(nothing, tmp_path)
    assert why in found.all
    assert found.chapters == ["What to do next", "The machine and the records", "Words"]
    assert found.sources == []


def test_base_model_and_last_step(explained):
    base = numbers.base_model(explained)
    assert base.effects == ()
    assert base.parameters == explained.history[0].model.parameters
    assert numbers.last_step(explained) is explained.history[-1]


def test_standard_errors_are_those_of_the_scatter(explained):
    errors = numbers.standard_errors(explained)
    truth = ambid.Model(explained.model.rig).add("loop_delay", {"delay": 5e-5})
    off = [
        (p.value - q.value) / errors[p.name] for p, q in zip(explained.model.parameters, truth.parameters, strict=True)
    ]
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 2.0


def test_no_report_without_a_place_for_it(explained, tmp_path):
    with pytest.raises(InputError, match=r"\.pdf"):
        write_report(explained, tmp_path / "report.pdf")
    with pytest.raises(InputError, match="no folder"):
        write_report(explained, tmp_path / "nowhere" / "report.html")


@pytest.mark.parametrize(
    ("value", "unit", "error", "text"),
    [
        (2.5e-4, "s", None, "250.0 µs"),
        (2.39e6, "N/m", 1200.0, "2.3900 ± 0.0012 MN/m"),
        (-0.72, "1", None, "−0.7200"),
        (0.0, "m", None, "0 m"),
        (300.3, "N s/m", 1.2, "300.3 ± 1.2 N s/m"),
        (1e-4, "s^0.5", None, "0.0001 s^0.5"),
    ],
)
def test_quantities(value, unit, error, text):
    assert words.quantity(value, unit, error) == text


@pytest.mark.parametrize(("chance", "text"), [(-1.0, "0.37"), (-230.2585, "10⁻¹⁰⁰"), (-1e6, "< 10⁻³⁰⁰")])
def test_p_values(chance, text):
    assert words.p_value(chance) == text
