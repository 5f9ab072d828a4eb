"""The report shows the course of a diagnosis in one self-contained file, with the numbers of the JSON."""

import json
import re

import pytest
from matplotlib.figure import Figure

import ambid
from ambid.errors import InputError
from ambid.report import numbers, pictures, report, words, write_report
from ambid.robustness.procedure import FEWEST_DRAWS
from report.page import Page, hash_of

CHAPTERS = 10


def test_explained_tells_the_whole_story_in_order(explained, whole, golden):
    golden.holds(whole.outline)
    assert len([level for level, _ in whole.headings if level == 2]) == CHAPTERS
    first, last = explained.history[0], explained.history[-1]
    (verdict,) = whole.classes["verdict"]
    for misfit in (first.misfit, last.misfit, first.validation_misfit, last.validation_misfit):
        assert words.misfit(misfit) in verdict
    own, kept_back = whole.tables["fits"]
    assert own[1] == f"{words.percent(first.fit_percent['average'])} → {words.percent(last.fit_percent['average'])}"
    assert words.percent(last.validation_fit_percent["average"]) in kept_back[1]
    assert explained.next_experiment[1:] in whole.classes["next"][0]


def test_headings_have_no_jump(whole):
    levels = [level for level, _ in whole.headings]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(then <= now + 1 for now, then in zip(levels, levels[1:], strict=False))


def test_figures_and_tables_are_numbered_in_order_and_all_referred_to(whole):
    assert set(whole.links) == set(whole.places)
    for kind in ("figure", "table"):
        own = [place for place in whole.places if place.startswith(kind)]
        assert own == [f"{kind}-{k + 1}" for k in range(len(own))]
        assert len(own) > 8
    assert len(whole.sources) == len([place for place in whole.places if place.startswith("figure")])
    captions = re.findall(r"<b>(Figure|Table) (\d+)\.</b>", whole.html)
    assert [f"{word.lower()}-{number}" for word, number in captions] == whole.places


def test_a_picture_is_drawn_into_the_page():
    picture = pictures.as_picture(Figure(figsize=(2.0, 1.0)), "Drawn.")
    assert picture.source.startswith("data:image/svg+xml;base64,")
    assert picture.caption == "Drawn."


@pytest.mark.slow
def test_all_pictures_are_drawn(written, whole):
    drawn = Page(written.read_text(encoding="utf-8"))
    assert (drawn.outline, drawn.images, drawn.places) == (whole.outline, whole.images, whole.places)
    assert all(source.startswith("data:image/svg+xml") for source in drawn.sources)
    assert len(set(drawn.sources)) == len(drawn.sources)


def test_files_are_told_with_their_hashes(explained, whole):
    rows = whole.tables["files"]
    paths = [explained.model.rig.path, explained.records[0].path, explained.validation[0].path]
    assert [row[0] for row in rows] == [path.name for path in paths]
    assert [row[1] for row in rows] == ["rig", "record", "validation"]
    assert [row[3] for row in rows] == list(map(hash_of, paths))


def test_version_and_date_are_told(whole):
    (made,) = whole.classes["made"]
    assert re.match(r"\d+ \w+ 20\d\d, \d\d:\d\d \S+, ", made)
    assert ambid.__version__ in made


def test_numbers_are_those_of_the_json(explained, whole):
    output = json.loads(json.dumps(explained.to_json()))
    for row, step in zip(whole.tables["ledger"], output["history"], strict=True):
        assert row[1] == words.misfit(step["misfit"])
        assert row[3] == words.percent(step["fit_percent"]["average"])
        assert row[4] == words.misfit(step["validation_misfit"])
    factors = {"N/A": 1.0, "kN/m": 1e3, "N/m": 1.0, "MN/m": 1e6, "µs": 1e-6}
    rows = whole.tables["parameters"]
    assert [row[0] for row in rows] == [
        name.replace("K_i", "Ki").replace("K_s", "Ks").replace("tau_e", "τe") for name in output["parameters"]
    ]
    for row, own in zip(rows, output["parameters"].values(), strict=True):
        low, high = (float(end) * factors[row[1]] for end in row[5].split(" to "))
        assert [float(row[4]) * factors[row[1]], low, high] == pytest.approx([own["value"], *own["ci95"]], rel=2e-3)
    moves = {own["parameter"]: own for own in output["history"][-1]["moved"]}
    first = moves[next(iter(output["parameters"]))]
    assert float(rows[0][7].replace("−", "-")) == pytest.approx(first["standard_errors"], rel=5e-3)
    candidates = output["history"][0]["candidates"]
    shown = whole.tables["ranking-1"]
    assert [row[0] for row in shown] == [own["effect"] for own in candidates[: len(shown)]]
    assert [row[1] for row in shown] == [words.misfit(own["predicted_misfit"]) for own in candidates[: len(shown)]]


def test_every_record_is_drawn_before_and_after(whole):
    names = [text for level, text in whole.headings if level == 3]
    first = names.index("train")
    assert names[first + 1].startswith("other")
    assert [whole.images[name] for name in names[first : first + 2]] == [2, 2]
    assert "shown" not in whole.tables  # the table of all records, which only many need


def test_margins_are_those_of_the_command(explained, whole):
    output = ambid.margins(explained.model, draws=FEWEST_DRAWS).to_json()
    own = output["axes"]["A_zeta"]
    row = whole.tables["margins"][0]
    assert row[1] == words.peak(own["sensitivity"]["value"])
    assert row[4] == " to ".join(map(words.peak, own["sensitivity"]["ci95"]))
    assert row[6] == own["zone"]
    assert float(row[7].rstrip(" %")) == pytest.approx(100 * own["zone_probability"][own["zone"]], abs=0.1)


def test_the_map_of_the_last_model_proves_that_nothing_is_left(explained, whole):
    assert sum(int((own.misfit > own.by_chance[:, None]).sum()) for own in explained.left) == 0
    cells = sum(own.misfit.size for own in explained.left)
    (left,) = whole.classes["left"]
    assert f" {cells} " in left


def test_base_model_and_last_step(explained):
    base = numbers.base_model(explained)
    assert base.effects == ()
    assert base.parameters == explained.history[0].model.parameters
    assert numbers.last_step(explained) is explained.history[-1]


def test_no_report_without_a_place_for_it(explained, tmp_path, golden):
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.docx")
    with golden.raises(InputError):
        write_report(explained, tmp_path / "nowhere" / "report.html")


def test_pdf_without_its_package_says_what_to_install(explained, tmp_path, monkeypatch, golden):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(report.importlib, "import_module", missing)
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.html", tmp_path / "report.pdf")
    assert not list(tmp_path.iterdir())


def test_pdf_without_pango_says_what_to_install(explained, tmp_path, monkeypatch, golden):
    def broken(name):
        raise OSError("cannot load library 'libpango-1.0-0'\nmore lines")

    monkeypatch.setattr(report.importlib, "import_module", broken)
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.pdf")
