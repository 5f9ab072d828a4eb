"""The report tells the story of each verdict in one self-contained file, with the numbers of the JSON."""

import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import ambid
from ambid.diagnosis import Diagnosis
from ambid.errors import InputError
from ambid.identification import ParameterEstimate
from ambid.report import numbers, pdf, words, write_report
from ambid.report.standing import DRAWS
from places import LEVITATOR

VOID = {"meta", "img"}
CHAPTERS = [
    "Verdict",
    "The machine and the records",
    "Measured against simulated, before and after",
    "Where the base model fails",
    "Which effect",
    "What it did to the parameters",
    "What is left",
    "Margins",
    "What to do next",
    "Words",
]


class Page(HTMLParser):
    """Text, headings, figures, tables, references and balance of the tags of a page."""

    def __init__(self, html):
        super().__init__()
        self.open, self.headings, self.sources, self.text = [], [], [], []
        self.places, self.links, self.html = [], [], html
        self.feed(html)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.sources += [attrs["src"]] if "src" in attrs else []
        if "href" in attrs:
            self.links.append(attrs["href"].removeprefix("#"))
        if "id" in attrs:
            self.places.append(attrs["id"])
            assert attrs["id"] in self.links, "shown before the text speaks of it"
        if tag in ("h1", "h2", "h3", "h4"):
            self.headings.append((int(tag[1]), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("h1", "h2", "h3"):
            level, text = self.headings[-1]
            self.headings[-1] = (level, text + data)
        self.text.append(data)

    @property
    def chapters(self):
        return [text for level, text in self.headings if level == 2]


@pytest.fixture(scope="module")
def explained(tmp_path_factory):
    rig = ambid.Rig.load(LEVITATOR)
    hidden = ambid.Model(rig).add("loop_delay", {"delay": 5e-5})
    i_e = ambid.prbs(9, amplitude=1.0, hold=4, axes=1, periods=4)
    folder = tmp_path_factory.mktemp("records")
    for name, factor, seed in (("train", 1.0, 1), ("other", 0.5, 2)):
        hidden.virtual_experiment(factor * i_e, seed=seed).save(folder / f"{name}.mat")
    found = ambid.diagnose(rig, folder / "train.mat", validate=[folder / "other.mat"])
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
    found.all = " ".join("".join(found.text).split())
    assert words.plain(diagnosis.verdict) in found.all
    return found


def table(html, caption):
    """Rows of texts of the table whose caption begins so."""
    own = next(own for own in re.findall(r"<table.*?</table>", html, re.DOTALL) if caption in own)
    rows = re.findall(r"<tr.*?</tr>", own.partition("<tbody>")[2], re.DOTALL)
    return [[re.sub("<.*?>", "", c).strip() for c in re.findall(r"<t[hd].*?</t[hd]>", row, re.DOTALL)] for row in rows]


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


def test_headings_have_no_jump(explained, tmp_path):
    levels = [level for level, _ in page(explained, tmp_path).headings]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(then <= now + 1 for now, then in zip(levels, levels[1:], strict=False))


def test_figures_and_tables_are_numbered_in_order_and_all_referred_to(explained, tmp_path):
    found = page(explained, tmp_path)
    assert set(found.links) == set(found.places)
    for kind in ("figure", "table"):
        own = [place for place in found.places if place.startswith(kind)]
        assert own == [f"{kind}-{k + 1}" for k in range(len(own))]
        assert len(own) > 8
    assert len(found.sources) == len([place for place in found.places if place.startswith("figure")])
    captions = re.findall(r"<b>(Figure|Table) (\d+)\.</b>", found.html)
    assert [f"{word.lower()}-{number}" for word, number in captions] == found.places


def test_files_are_told_with_their_hashes(explained, tmp_path):
    rows = table(write_report(explained, tmp_path / "report.html").read_text(encoding="utf-8"), "The files.")
    paths = [explained.model.rig.path, explained.records[0].path, explained.validation[0].path]
    assert [row[0] for row in rows] == [path.name for path in paths]
    assert [row[1] for row in rows] == ["rig", "record", "validation"]
    for row, path in zip(rows, paths, strict=True):
        assert row[3] == hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def test_hashes_are_those_of_what_was_read(explained, tmp_path):
    rig, record = tmp_path / "rig.toml", tmp_path / "run.mat"
    rig.write_bytes(LEVITATOR.read_bytes().replace(b"\n", b"\r\n"))
    explained.records[0].save(record)
    hashes = [hashlib.sha256(path.read_bytes()).hexdigest()[:16] for path in (rig, record)]
    machine = ambid.Rig.load(rig)
    read = ambid.Record.load(record, machine)
    rig.write_text("another one")
    record.unlink()
    model = ambid.Model(machine)
    found = page(Diagnosis.uninformative(model, [read.rows(0, read.samples)], ["why"], 0.0), tmp_path)
    assert [row[3] for row in table(found.html, "The files.")] == hashes


def test_what_is_in_no_file_is_said_so(explained, tmp_path):
    record = replace(explained.records[0], path=None, provenance=None)
    found = page(Diagnosis.uninformative(explained.model, [record], ["why"], 0.0), tmp_path)
    assert "made in memory, read from no file" in found.all


def test_version_and_date_are_told(explained, tmp_path):
    assert re.search(rf"\d+ \w+ 20\d\d, \d\d:\d\d \S+, by ambid {ambid.__version__}", page(explained, tmp_path).all)


def test_numbers_are_those_of_the_json(explained, tmp_path):
    html = write_report(explained, tmp_path / "report.html").read_text(encoding="utf-8")
    told = json.loads(json.dumps(explained.to_json()))
    for row, step in zip(table(html, "Step by step"), told["history"], strict=True):
        assert row[1] == words.misfit(step["misfit"])
        assert row[3] == words.percent(step["fit_percent"]["average"])
        assert row[4] == words.misfit(step["validation_misfit"])
    factors = {"N/A": 1.0, "kN/m": 1e3, "N/m": 1.0, "MN/m": 1e6, "µs": 1e-6}
    rows = table(html, "Parameters of the last model")
    assert [row[0] for row in rows] == [
        name.replace("K_i", "Ki").replace("K_s", "Ks").replace("tau_e", "τe") for name in told["parameters"]
    ]
    for row, own in zip(rows, told["parameters"].values(), strict=True):
        low, high = (float(end) * factors[row[1]] for end in row[5].split(" to "))
        assert [float(row[4]) * factors[row[1]], low, high] == pytest.approx([own["value"], *own["ci95"]], rel=2e-3)
    moves = {own["parameter"]: own for own in told["history"][-1]["moved"]}
    first = moves[next(iter(told["parameters"]))]
    assert float(rows[0][7].replace("−", "-")) == pytest.approx(first["standard_errors"], rel=5e-3)
    candidates = told["history"][0]["candidates"]
    shown = table(html, "The candidates")
    assert [row[0] for row in shown] == [own["effect"] for own in candidates[: len(shown)]]
    assert [row[1] for row in shown] == [words.misfit(own["predicted_misfit"]) for own in candidates[: len(shown)]]


def test_every_record_is_drawn_before_and_after(explained, tmp_path):
    found = page(explained, tmp_path)
    headings = [text for level, text in found.headings if level == 3]
    assert headings[headings.index("train") + 1] == "other, for validation"
    for name in ("train", "other"):
        # in the caption and in the alternative text
        assert found.html.count(f"of {name}, in the stretch where the base model misses most") == 2
        assert found.html.count(f"of {name}, which the base model misses most") == 2
    assert "All records" not in found.all


def test_of_many_records_the_worst_three_are_drawn_and_a_table_has_all(explained, tmp_path):
    base, record, other = explained.history[0].model, explained.records[0], explained.validation[0]
    records = [replace(other if k == 1 else record, name=f"run {k}") for k in range(4)]
    several = replace(explained, records=tuple(records), fit=ambid.compare(explained.model, records))
    found = page(several, tmp_path)
    rows = table(found.html, "All records")
    assert [row[:2] for row in rows] == [*([f"run {k}", "diagnosis"] for k in range(4)), ["other", "validation"]]
    before, after = (several.fit.of(model).records for model in (base, explained.model))
    for row, was, now in zip(rows, before, after, strict=False):
        assert row[4] == f"{words.misfit(was.misfit)} → {words.misfit(now.misfit)}"
    drawn = re.findall(r"of (run \d|other), in the stretch", found.html)
    worst = sorted(sorted(range(4), key=lambda k: -before[k].misfit)[:3])
    assert drawn == [name for k in worst for name in (f"run {k}",) * 2]


def test_margins_are_those_of_the_command(explained, tmp_path):
    html = write_report(explained, tmp_path / "report.html").read_text(encoding="utf-8")
    told = ambid.margins(explained.model, draws=DRAWS).to_json()
    own = told["axes"]["A_zeta"]
    row = table(html, "Peaks of the sensitivity")[0]
    assert row[1] == words.peak(own["sensitivity"]["value"])
    assert row[4] == " to ".join(map(words.peak, own["sensitivity"]["ci95"]))
    assert row[6] == own["zone"]
    assert float(row[7].rstrip(" %")) == pytest.approx(100 * own["zone_probability"][own["zone"]], abs=0.1)


def test_an_unstable_model_has_no_margins_and_a_report(explained, tmp_path):
    weak = explained.model.with_values({"K_i.A_zeta": 1e-3 * explained.model.theta[0]})
    assert not weak.is_stable
    found = page(replace(explained, model=weak), tmp_path)
    assert "The loop has no margins to tell" in found.all


def test_the_map_of_the_last_model_proves_that_nothing_is_left(explained, tmp_path):
    found = page(explained, tmp_path)
    assert re.search(r"none of the \d+ cells of channel and band hold more than chance may bring", found.all)
    assert sum(int((own.misfit > own.by_chance[:, None]).sum()) for own in explained.left) == 0


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
    assert "What it did to the parameters" not in found.chapters
    assert "Parameters of the base model" in found.all


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
    assert "The shape of what is missing" not in found.all


def test_not_informative_says_why_and_what_to_do(explained, tmp_path):
    why = "train: only 2 periods <of> the excitation"
    nothing = Diagnosis.uninformative(explained.model, explained.records, [why], 0.0)
    found = page(nothing, tmp_path)
    assert why in found.all
    assert found.chapters == ["Verdict", "The machine and the records", "What to do next", "Words"]
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


def test_no_report_without_a_place_for_it(explained, tmp_path, golden):
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.docx")
    with golden.raises(InputError):
        write_report(explained, tmp_path / "nowhere" / "report.html")


def test_pdf_without_its_package_says_what_to_install(explained, tmp_path, monkeypatch, golden):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(pdf.importlib, "import_module", missing)
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.html", tmp_path / "report.pdf")
    assert not list(tmp_path.iterdir())


def test_pdf_without_pango_says_what_to_install(explained, tmp_path, monkeypatch, golden):
    def broken(name):
        raise OSError("cannot load library 'libpango-1.0-0'\nmore lines")

    monkeypatch.setattr(pdf.importlib, "import_module", broken)
    with golden.raises(InputError):
        write_report(explained, tmp_path / "report.pdf")


def installed():
    """WeasyPrint; the test is skipped where it is not there, or does not find Pango."""
    try:
        return pdf.weasyprint()
    except InputError as error:
        pytest.skip(str(error))


def boxes(box):
    yield box
    for child in getattr(box, "children", ()):
        yield from boxes(child)


def test_on_paper_no_page_but_the_last_is_half_empty(explained, tmp_path):
    weasyprint = installed()
    html = write_report(explained, tmp_path / "report.html").read_text(encoding="utf-8")
    pages = weasyprint.HTML(string=html).render().pages
    for sheet in pages[:-1]:
        inner = sheet._page_box
        ends = [
            box.position_y + box.height
            for box in boxes(inner)
            if (getattr(box, "text", "") or box.element_tag == "img") and box.position_y < 0.93 * sheet.height
        ]
        assert max(ends) > 0.7 * sheet.height


def test_pdf_is_the_same_on_a4_and_nothing_is_cut_off(explained, tmp_path):
    weasyprint = installed()
    html, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    assert write_report(explained, html, paper) == html
    assert paper.read_bytes().startswith(b"%PDF-")
    document = weasyprint.HTML(string=html.read_text(encoding="utf-8")).render()
    assert 4 <= len(document.pages) <= 12
    inches = 1.0 / 96.0
    for sheet in document.pages:
        assert (sheet.width * inches, sheet.height * inches) == pytest.approx((8.27, 11.69), abs=0.01)
        right = sheet.width - 0.5 / inches
        for box in boxes(sheet._page_box):
            if getattr(box, "text", "") or box.element_tag in ("img", "table"):
                assert 0.0 <= box.position_x <= box.position_x + box.width <= right


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2.5e-4, "s", "250.0 µs"),
        (2.39e6, "N/m", "2.390 MN/m"),
        (-0.72, "1", "−0.7200"),
        (0.0, "m", "0 m"),
        (300.3, "N s/m", "300.3 N s/m"),
        (1e-4, "s^0.5", "0.0001 s^0.5"),
    ],
)
def test_quantities(value, unit, text):
    assert words.quantity(value, unit) == text


def test_a_parameter_has_as_many_decimals_as_its_interval_tells():
    row = words.Row.of("K_s.x", ParameterEstimate.normal(2.39e6, 1200.0, "N/m"), 2.2e6, 2.1e6, None)
    assert (row.unit, row.told, row.before, row.now) == ("MN/m", "2.2", "2.1000", "2.3900")
    assert row.interval == "2.3876 to 2.3924"
    unknown = words.Row.of("K_s.x", ParameterEstimate(None, None, None, "N/m"), None, None, None)
    assert (unknown.now, unknown.interval, unknown.errors) == ("–", "–", "–")


@pytest.mark.parametrize(("chance", "text"), [(-1.0, "0.37"), (-230.2585, "10⁻¹⁰⁰"), (-1e6, "< 10⁻³⁰⁰")])
def test_p_values(chance, text):
    assert words.p_value(chance) == text
