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
    i_e = ambid.prbs(9, amplitude=0.3, hold=2, axes=1, periods=4)
    ambid.Model(rig).virtual_experiment(i_e, seed=4).save(folder / "run.csv")
    return folder / "rig.toml", folder / "run.csv"


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return files


@pytest.mark.slow
def test_a_response_is_made_written_drawn_and_read_again(here, command):
    rig, run = here
    made = command("frequency-response", rig, run, "--out", "frf.mat", "--plot", "frf.png", "--json", "frf.json")
    assert (made.code, made.err) == (0, "")
    assert Path("frf.png").stat().st_size > 10_000
    shown = json.loads(Path("frf.json").read_text())
    (own,) = shown["responses"]
    assert own["outputs"] == ["y.A_zeta", "i_c.A_zeta"]
    assert len(own["response"]) == len(own["model"]) == len(own["std"]) == len(own["frequency_hz"])
    assert len(own["response"][0][0][0]) == 2
    assert shown["records"][0]["misfit"] == pytest.approx(1.0, abs=0.2)
    for name in ("identify", "compare", "diagnose"):
        found = command(name, rig, "frf.mat", run, "--json", f"{name}.json")
        assert (found.code, found.err) == (0, ""), name
    assert json.loads(Path("identify.json").read_text())["adequate"]
    assert json.loads(Path("diagnose.json").read_text())["verdict"] == "adequate"
    assert command("check", rig, "frf.mat").code == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("job", "options"), [("identify", ["--plot", "i.png"]), ("diagnose", ["--report", "d.html", "--plot", "d.png"])]
)
def test_a_response_is_drawn_and_reported_like_a_record(here, command, job, options):
    rig, run = here
    assert command("frequency-response", rig, run, "--out", "frf.mat", "-q").code == 0
    found = command(job, rig, "frf.mat", run, *options)
    assert (found.code, found.err) == (0, "")
    assert all(f"written: {Path(name).stem}" in found.out for name in options[1::2])


def test_what_is_there_is_not_replaced(here, command, refused):
    rig, run = here
    Path("frf.csv").write_text("mine")
    refused(command("frequency-response", rig, run, "--out", "frf.csv"), "frf.csv")
    assert Path("frf.csv").read_text() == "mine"
    assert command("frequency-response", rig, run, "--out", "frf.csv", "--force", "-q").code == 0


def test_a_format_that_is_not_written_is_refused_before_the_work(here, command, refused):
    refused(command("frequency-response", *here, "--out", "frf.uff"), "frf.uff")


def test_a_broken_response_is_named(here, command, refused):
    rig, _ = here
    Path("frf.csv").write_text("frequency_hz,output,input,re,im\n10,y.A_zeta,i_e.A_zeta,x,0\n")
    refused(command("identify", rig, "frf.csv"), "frf.csv: re, row 1: 'x'")
