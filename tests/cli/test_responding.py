"""Frequency responses from the shell: made, written, drawn, and taken by the other commands like records."""

import json
from pathlib import Path

import pytest

import ambid
from places import LEVITATOR


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A rig file of one axis, and a record of it."""
    folder = tmp_path_factory.mktemp("responding")
    rig = ambid.Rig.load(LEVITATOR)
    (folder / "rig.toml").write_text(rig.to_toml())
    i_e = ambid.prbs(11, amplitude=0.3, hold=2, axes=1, periods=4)
    ambid.Model(rig).virtual_experiment(i_e, seed=4).save(folder / "run.csv")
    return folder / "rig.toml", folder / "run.csv"


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return files


def test_a_response_is_made_written_drawn_and_read_again(here, command):
    rig, run = here
    made = command("frequency-response", rig, run, "--out", "frf.mat", "--plot", "frf.png", "--json", "frf.json")
    assert (made.code, made.err) == (0, "")
    assert "misfit" in made.out
    assert Path("frf.png").stat().st_size > 10_000
    told = json.loads(Path("frf.json").read_text())
    (own,) = told["responses"]
    assert own["outputs"] == ["y.A_zeta", "i_c.A_zeta"]
    assert len(own["response"]) == len(own["model"]) == len(own["std"]) == len(own["frequency_hz"])
    assert len(own["response"][0][0][0]) == 2
    assert told["records"][0]["misfit"] == pytest.approx(1.0, abs=0.2)
    for name, arguments in {
        "identify": ["--plot", "i.png"],
        "compare": [],
        "diagnose": ["--report", "d.html", "--plot", "d.png"],
    }.items():
        found = command(name, rig, "frf.mat", run, *arguments, "--json", f"{name}.json")
        assert (found.code, found.err) == (0, ""), name
    assert json.loads(Path("identify.json").read_text())["adequate"]
    assert json.loads(Path("diagnose.json").read_text())["verdict"] == "adequate"
    assert command("check", rig, "frf.mat").code == 0


def test_what_is_there_is_not_replaced(here, command):
    rig, run = here
    Path("frf.csv").write_text("mine")
    found = command("frequency-response", rig, run, "--out", "frf.csv")
    assert found.code == 2
    assert "frf.csv: is there already" in found.err
    assert Path("frf.csv").read_text() == "mine"
    assert command("frequency-response", rig, run, "--out", "frf.csv", "--force", "-q").code == 0


def test_a_format_that_is_not_written_is_refused_before_the_work(here, command):
    found = command("frequency-response", *here, "--out", "frf.uff")
    assert found.code == 2
    assert "use one of .csv, .mat" in found.err


def test_a_broken_response_is_named(here, command):
    rig, _ = here
    Path("frf.csv").write_text("frequency_hz,output,input,re,im\n10,y.A_zeta,i_e.A_zeta,x,0\n")
    found = command("identify", rig, "frf.csv")
    assert found.code == 2
    assert "frf.csv: re, row 1: 'x' is not a number" in found.err
