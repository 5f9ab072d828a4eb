"""A commented rig file to begin from: as it is, it loads, is sound, and can be identified."""

import json
from pathlib import Path

import pytest

import ambid
from ambid.rig.template import KINDS, OF_SHAFTS, rig_template
from ambid.rig.tolerance import SOURCES, TYPICAL


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_loads_is_sound_and_is_commented(kind, command):
    made = command("init", kind, "--out", "own.toml", "--json", "told.json")
    assert (made.code, made.err) == (0, "")
    assert "own.toml" in made.out
    assert json.loads(Path("told.json").read_text()) == {"rig": "own.toml", "kind": kind, "findings": []}
    rig = ambid.Rig.load("own.toml")
    assert ambid.Model(rig).is_stable
    assert command("check", "own.toml").code == 0
    text = Path("own.toml").read_text()
    for unit in ("# Hz", "# m", "# A", "# s", "# N/A", "# N/m"):
        assert unit in text.replace("N/A, nominal", "N/A"), unit


@pytest.mark.parametrize("kind", KINDS)
def test_its_tolerances_are_the_typical_ones_with_their_sources(kind):
    rig = ambid.Rig.from_toml(rig_template(kind))
    stated = {key: value for key in TYPICAL if (value := rig.tolerance.stated(key)) is not None}
    assert stated.items() <= TYPICAL.items()
    without = OF_SHAFTS if kind == "levitator" else ()
    assert set(stated) == set(TYPICAL) - set(without)
    words = " ".join(line.lstrip("# ") for line in rig_template(kind).splitlines())
    assert all(SOURCES[key] in words for key in stated)
    names = {p.name.partition(".")[0] for p in ambid.Model(rig).with_tolerances().tolerances}
    assert names <= set(stated)


def test_what_it_writes_can_be_simulated_and_identified(command):
    assert command("init", "levitator").code == 0
    assert command("simulate", "rig.toml", "--out", "run.csv", "--seconds", "0.5", "-q").code == 0
    assert command("identify", "rig.toml", "run.csv", "--json", "-", "-q").code == 0


def test_what_is_there_is_not_replaced(command, refused):
    Path("rig.toml").write_text("mine")
    refused(command("init"), "rig.toml")
    assert Path("rig.toml").read_text() == "mine"
    assert command("init", "--force").code == 0


@pytest.mark.parametrize(("arguments", "named"), [(["modal"], "modal_rotor"), (["pid", "--out", "rig.txt"], "rig.txt")])
def test_what_is_wrong_is_told(command, arguments, named, refused):
    refused(command("init", *arguments), named)
