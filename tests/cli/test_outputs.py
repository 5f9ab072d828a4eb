"""What a command may write is known before it works, and nothing that a user has is replaced unasked."""

import json
import os
import sys
from pathlib import Path

import pytest

import ambid
from ambid.demo import FILES
from places import LEVITATOR


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    rig = ambid.Rig.load(LEVITATOR)
    i_e = ambid.prbs(7, amplitude=0.1, hold=2, axes=1, periods=6)
    ambid.Model(rig).virtual_experiment(i_e, seed=3).save(folder / "run.csv")
    return folder


@pytest.fixture
def files(made, tmp_path, monkeypatch):
    """A folder with a rig, two records and a model, in which the command runs."""
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(LEVITATOR.read_text())
    for name in ("run.csv", "other.csv"):
        Path(name).write_bytes((made / "run.csv").read_bytes())
    Path("link.json").symlink_to("run.csv")
    Path("hard.json").hardlink_to("rig.toml")
    ambid.Model(ambid.Rig.load("rig.toml")).save("model.json")
    return {path.name: path.read_bytes() for path in tmp_path.iterdir()}


IDENTIFY, DIAGNOSE = ("identify", "rig.toml", "run.csv"), ("diagnose", "rig.toml", "run.csv")
SAME = {
    "json, the rig": ((*IDENTIFY, "--json", "rig.toml"), "--json", "RIG"),
    "json, the record": (("compare", *IDENTIFY[1:], "--json", "run.csv"), "--json", "RECORD"),
    "json, another way to the record": (("check", *IDENTIFY[1:], "--json", "../{here}/run.csv"), "--json", "RECORD"),
    "json, a link to the record": ((*DIAGNOSE, "--json", "link.json"), "--json", "RECORD"),
    "json, a hard link to the rig": ((*IDENTIFY, "--json", "hard.json"), "--json", "RIG"),
    "json, a record for validation": (
        (*DIAGNOSE, "--validate", "other.csv", "--json", "other.csv"), "--json", "--validate"
    ),
    "save, the model": ((*IDENTIFY, "--model", "model.json", "--save", "model.json"), "--save", "--model"),
    "save, the rig": ((*DIAGNOSE, "--save", "./rig.toml"), "--save", "RIG"),
    "json and save": ((*IDENTIFY, "--json", "a.json", "--save", "a.json"), "--save", "--json"),
    "json and save but for case": ((*DIAGNOSE, "--json", "a.json", "--save", "A.json"), "--save", "--json"),
    "json and the second picture": (
        ("compare", *IDENTIFY[1:], "other.csv", "--json", "f_2.png", "--plot", "f.png"), "--plot", "--json"
    ),
    "json, a loading": (("static-load", *IDENTIFY[1:], "--json", "run.csv"), "--json", "LOADS"),
    "json, the rig of the catalogue": (("effects", "--rig", "rig.toml", "--json", "rig.toml"), "--json", "--rig"),
    "json and out": (
        ("simulate", "rig.toml", "--out", "run.csv", "--force", "--json", "run.csv"), "--json", "--out"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", SAME)
def test_an_output_that_is_an_input_or_another_output(case, files, command, tmp_path):
    arguments, option, other = SAME[case]
    result = command(*(word.format(here=tmp_path.name) for word in arguments))
    assert (result.code, result.out) == (2, "")
    assert result.err.startswith("error: ")
    assert {option, other} <= set(result.err.split())
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == files


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("check", "rig.toml", "--json", "other.csv"), "other.csv"),
        (("check", "rig.toml", "--json", "link.json"), "link.json"),
        (("effects", "--json", "rig.toml"), "rig.toml"),
        (("identify", "rig.toml", "run.csv", "--save", "other.csv"), "other.csv"),
        (("simulate", "rig.toml", "--out", "run.csv"), "run.csv"),
        (("simulate", "rig.toml", "--out", "rig.toml", "--force"), "rig.toml"),
        (("demo", "--out", "."), "model.json"),
        (("demo", "--out", "rig.toml"), "rig.toml"),
        (("demo", "--out", "new", "--json", "new/model.json"), "new/model.json"),
    ],
    ids=lambda value: "_".join(value) if isinstance(value, tuple) else "",
)
def test_what_a_user_has_is_not_replaced(arguments, named, files, command, tmp_path, refused):
    refused(command(*arguments), named)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == files


def test_results_replace_results(files, command):
    for _ in range(2):
        options = ("--json", "i.json", "--save", "m.json", "--plot", "i.png")
        assert command("identify", "rig.toml", "run.csv", *options).code == 0
    assert json.loads(Path("i.json").read_text())["status"] == "converged"


def test_a_record_is_replaced_by_force(files, command):
    result = command("simulate", "rig.toml", "--out", "run.csv", "--force", "--seconds", "0.1")
    assert (result.code, result.err) == (0, "")
    assert Path("run.csv").read_bytes() != files["run.csv"]


def test_one_device_for_several_outputs(files, command):
    result = command("identify", "rig.toml", "run.csv", "--json", os.devnull, "--save", os.devnull)
    assert (result.code, result.err) == (0, "")


def test_a_pipe_is_no_place_for_a_record(files, command, refused):
    os.mkfifo("v.csv")
    refused(command("simulate", "rig.toml", "--out", "v.csv", "--force"), "v.csv")


def test_the_demo_replaces_its_own_files_where_nothing_else_is(tmp_path, monkeypatch, command):
    """The story itself, which takes long, is left out."""
    folder, shown = tmp_path / "story", []
    monkeypatch.setattr("ambid.demo.run", lambda out, say: shown.append(out) or {})
    folder.mkdir()
    (folder / FILES[0]).write_text("before")
    assert command("demo", "--out", folder).code == 0
    (folder / "notes.txt").write_text("mine")
    assert command("demo", "--out", folder).code == 2
    assert command("demo", "--out", folder, "--force").code == 0
    assert shown == [folder, folder]


def test_a_record_in_a_format_whose_package_is_missing(files, command, monkeypatch, refused):
    """Known before the simulation."""
    monkeypatch.setitem(sys.modules, "h5py", None)
    monkeypatch.setattr(ambid.Model, "virtual_experiment", None)
    refused(command("simulate", "rig.toml", "--out", "v.h5"), "h5py")


def test_json_that_is_printed_stands_alone(tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    found = command("margins", LEVITATOR, "--json", "-", "--plot", "s.png")
    assert found.code == 0
    assert json.loads(found.out)["zone"] == "A"
    assert Path("s.png").exists()
