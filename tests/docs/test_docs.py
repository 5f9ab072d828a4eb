"""The documents without Sphinx: their blocks run, what is generated is whole, and they name what exists."""

import re
import sys
from pathlib import Path

import pytest

import ambid
import validated
from ambid.demo import DATA
from ambid.effects import CATALOGUE
from ambid.findings import Kind
from ambid.noise.adequacy import INCONSISTENT, Adequacy, Criterion
from parsed import read_by_the_command_line
from places import ROOT

DOCS = ROOT / "python" / "docs"
sys.path.append(str(DOCS / "_ext"))

import blocks  # noqa: E402
import catalogue  # noqa: E402
import interface  # noqa: E402
import kinds  # noqa: E402
import pages  # noqa: E402
import plant  # noqa: E402
import records  # noqa: E402
import rig_file  # noqa: E402
import rooms  # noqa: E402
import thresholds  # noqa: E402
import validation  # noqa: E402
from words import meanings  # noqa: E402

BENCH = ambid.Rig.load(DATA / "rig.toml").replace(speed=200.0)
PAGES = sorted(path.name for path in DOCS.glob("*.md"))


def text(page):
    return (DOCS / page).read_text(encoding="utf-8")


RUN = [page for page in PAGES if blocks.blocks(text(page))]
LONG = (
    *("adding_an_effect.md", "excitation.md", "first_hour.md", "records.md", "results.md", "rig_file.md"),
    *("workbench.md", "your_machine.md"),
)
"""What takes seconds: also run whenever the documents are built."""


@pytest.mark.parametrize("page", [pytest.param(page, marks=[pytest.mark.slow] if page in LONG else []) for page in RUN])
def test_every_block_runs_and_prints_what_the_page_takes_for_granted(page, tmp_path):
    assert "```text" in pages.with_output(text(page), page, tmp_path)


@pytest.mark.parametrize("page", RUN)
def test_every_block_is_python_or_a_command_with_its_options(page):
    for block in blocks.blocks(text(page)):
        if block.language == "python":
            compile(block.code, page, "exec")
        for words in block.commands if block.language == "sh" else ():
            read_by_the_command_line(words)


@pytest.mark.parametrize("page", RUN)
def test_a_page_says_what_its_words_take_for_granted(page):
    assert pages.PRINTED.search(text(page))


BLOCK = "```python\nprint(6 * 7)\n```\n% output\n% printed: ^{}$\n"


def test_what_a_page_takes_for_granted_must_be_printed(tmp_path):
    assert "\n42\n" in pages.with_output(BLOCK.format("42"), "page", tmp_path)
    with pytest.raises(RuntimeError, match=r"\^43\$"):
        pages.with_output(BLOCK.format("43"), "page", tmp_path)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        ("```python\n1 / 0\n```\n", "ZeroDivisionError"),
        ("```sh\nambid compare nothing.toml a.mat\n```\n", "nothing.toml"),
    ],
)
def test_a_block_that_fails_ends_the_page_with_its_error(block, said, tmp_path):
    with pytest.raises(RuntimeError, match=said):
        list(blocks.run(block, "page", tmp_path))


def test_no_block_is_of_a_language_that_is_not_checked():
    for page in PAGES:
        checked = {"python", "sh", "console"} | ({"c"} if page == "embedded.md" else set())  # by embedded/test_c.py
        assert set(re.findall(r"^```(\w+)", text(page), re.MULTILINE)) <= checked, page


def test_commands_for_developers_are_those_that_are_checked():
    checked = (ROOT / ".ci" / "run").read_text() + (ROOT / "README.md").read_text()
    commands = re.findall(r"^\$ (.*)$", text("developing.md"), re.MULTILINE)
    assert commands
    for command in commands:
        assert command in checked


def test_files_that_pages_name_exist():
    for page in PAGES:
        for name in re.findall(r"`((?:python|tests|rust|\.ci)/[\w./]+)`", text(page)):
            assert (ROOT / name).exists(), (page, name)


def test_the_picture_of_the_readme_is_small_and_there():
    (picture,) = re.findall(r"!\[.*\]\((.*)\)", (ROOT / "README.md").read_text())
    assert 10_000 < (ROOT / picture).stat().st_size < 150_000


def test_constants_on_the_pages_exist():
    for page in PAGES:
        for package, name in re.findall(r"\{\{(\w+)\.(\w+)\}\}", text(page)):
            assert thresholds.value_text(package, name)


@pytest.mark.parametrize("package", thresholds.ENGINE)
def test_every_constant_of_the_engine_says_what_it_means(package):
    silent = [f"{c.module}.{c.name}" for c in thresholds.constants(package) if not c.meaning]
    assert not silent, f"write below each what it means, as a text: {silent}"


def test_every_key_of_the_rig_file_is_told():
    shown = rig_file.generate(Path())
    for title, model, _ in rig_file.tables_of("", ambid.Rig):
        for name, field in model.model_fields.items():
            assert f"| `{field.alias or name}` |" in shown, title
            assert name == "kind" or meanings(model).get(name) or field.description, (title, name)


def test_units_and_ranges_of_the_rig_file():
    shown = rig_file.generate(Path())
    assert "| `air_gap` | number | m | 1e-5 to 0.1 | **needed** |" in shown
    assert "| `has_lag` | `true` or `false` |  |  | `true` |" in shown
    of_rotors, _ = shown.split("### `[tolerance]`")
    for row in (line for line in of_rotors.splitlines() if line.startswith("| `modal_damping` |")):
        assert [cell.strip() for cell in row.split("|")][3:6] == ["", "0 to 0.5", "`0.0`"]
    assert '`"finite_elements"` |  |  | `"finite_elements"` |' in shown
    assert '`"pid"` |  |  | **needed** |' in shown


def test_formats_and_gates_of_records():
    shown = records.generate(Path())
    for part in ("`.tdms` | nptdms", "`.csv` | nothing", "`i_c`", "require_metres", "F_x and F_y"):
        assert part in shown


def test_every_kind_of_finding_is_told_with_its_room():
    shown = kinds.generate(Path())
    for room, own in kinds.kinds().items():
        assert f"ambid.{room}" in shown
        assert all(f"| `{kind.code}` | {kind.severity} |" in shown for kind in own)
    modules = [module for name, module in list(sys.modules.items()) if name.startswith("ambid.")]
    declared = {own.code for module in modules for own in vars(module).values() if isinstance(own, Kind)}
    assert declared == {kind.code for own in kinds.kinds().values() for kind in own}


def test_everything_at_the_top_is_in_the_reference():
    shown = interface.generate(Path())
    for name in ambid.__all__:
        assert not callable(getattr(ambid, name)) or f":: ambid.{name}\n" in shown


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_every_effect_has_what_its_part_of_the_catalogue_tells(effect):
    assert all((effect.physics, effect.equation, effect.signature, effect.source))
    assert [p.name for p in effect.parameters(BENCH) if not p.meaning] == []


@pytest.fixture(scope="module")
def the_catalogue(tmp_path_factory):
    """Page and folder of its pictures."""
    folder = tmp_path_factory.mktemp("catalogue")
    return catalogue.generate(folder), folder


@pytest.mark.slow
@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_every_effect_is_told_and_drawn(effect, the_catalogue):
    shown, folder = the_catalogue
    assert (folder / f"{effect.name}.svg").stat().st_size > 5000
    part = shown.partition(f"\n\n`{effect.name}`: ")[2].partition("**Source.**")[0]
    assert "``" in part.partition("**Equation.**")[2].partition("**Parameters.**")[0]
    for p in effect.parameters(BENCH):
        assert f"| `{p.name}`" in part


def test_tables_and_pictures_of_benchmarks_are_taken_where_they_are(tmp_path):
    asked = "% measured: calibration/nulls.md\n\n% measured: calibration/nulls.png\n"
    assert pages.with_measured(asked, tmp_path) == f"{pages.NOT_YET}\n\n\n"
    (tmp_path / "calibration").mkdir()
    (tmp_path / "calibration" / "nulls.md").write_text("| a |\n| --- |\n")
    (tmp_path / "calibration" / "nulls.png").touch()
    shown = pages.with_measured(asked, tmp_path)
    assert shown == "| a |\n| --- |\n\n![Nulls](calibration/nulls.png)\n"


def test_every_figure_in_the_folder_is_on_a_page():
    shown = [name for page in PAGES for name in pages.MEASURED.findall(text(page))]
    for path in (DOCS / "calibration").glob("*.*"):
        assert f"calibration/{path.name}" in shown, path


def test_the_validation_has_a_row_of_every_claim_of_the_tests_and_no_other():
    rows = [(row["test"], row["claim"], row["reference"]) for row in validated.read()]
    assert sorted(rows) == sorted(validated.claimed())
    assert all(row["figure"] <= row["tolerance"] for row in validated.read())
    shown = validation.generate(Path())
    assert all(f"| `{test}` |" in shown for test, _, _ in rows)


def test_every_key_of_the_results_is_told():
    rig = ambid.Rig.load(DATA / "rig.toml")
    record = ambid.Record.load(DATA / "prbs.mat", rig)
    of_identify, of_diagnose = text("results.md").partition("## `identify`")[2].split("## `diagnose`")
    estimate = ambid.identify(rig, record)
    diagnosis = ambid.Diagnosis.uninformative(estimate.model, [record], [], 0.0)
    for shown, result in ((of_identify, estimate), (of_diagnose, diagnosis)):
        assert [key for key in result.to_json() if f"`{key}`" not in shown] == []


def test_every_test_that_a_model_must_pass_is_told():
    shown = text("results.md").partition("## Tests that a model must pass")[2].partition("\n## ")[0]
    names = set(re.findall(r"^\| `(\w+)` \|", shown, re.MULTILINE)) - {"test"}
    of_diagnosis = {"line", "drift", "validation", "ways"}
    assert names == INCONSISTENT.keys() | of_diagnosis
    assert all(f"``{name}``" in (Criterion.__doc__ or "") for name in names)
    made = Adequacy().beside(Criterion("power", 2.0, 10.0)).as_dict()[0]
    assert [key for key in made if f"`{key}`" not in shown] == []


def test_rooms_and_plant():
    shown = rooms.generate(Path())
    assert shown.index("`ambid.rig`") < shown.index("`ambid.noise` | Noise") < shown.index("`ambid.cli`")
    assert "`inject(" in plant.generate(Path())
