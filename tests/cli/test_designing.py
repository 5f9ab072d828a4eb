"""The commands that plan experiments."""

import json
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

import ambid
from ambid.cli.app import app
from places import BENCH, LEVITATOR


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=True)


@pytest.fixture
def rig(tmp_path):
    return shutil.copy(LEVITATOR, tmp_path / "rig.toml")


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".wav"])
def test_excitation_writes_and_tells(rig, tmp_path, suffix):
    out, told = tmp_path / f"i_e{suffix}", tmp_path / "told.json"
    ended = run("excitation", rig, "--out", out, "--order", 7, "--periods", 4, "--json", told)
    assert ended.exit_code == 0, ended.output
    data = json.loads(told.read_text())
    assert (data["period"], data["periods"], data["axes"][0]["i_e"]) == (254, 4, 0.1)
    assert ("full_scale" in data) == (suffix == ".wav")
    assert out.stat().st_size > 1000
    assert "y peak" in ended.output


def test_excitation_of_some_axes_leaves_the_others_still(tmp_path):
    out = tmp_path / "i_e.csv"
    arguments = ("--signal", "multisine", "--band", "20:500", "--period", 1000, "--amplitude", 0.3)
    ended = run("excitation", BENCH, "--out", out, *arguments, "--axes", "B_eta,A_zeta")
    assert ended.exit_code == 0, ended.output
    table = np.genfromtxt(out, delimiter=",", names=True, deletechars="")
    assert not table["i_e.A_eta"].any()
    np.testing.assert_allclose(np.abs(table["i_e.B_eta"]).max(), 0.3)
    np.testing.assert_allclose(np.abs(table["i_e.A_zeta"]).max(), 0.3)


def test_excitation_replaces_nothing_without_force(rig, tmp_path):
    out = tmp_path / "i_e.csv"
    out.write_text("mine")
    refused = run("excitation", rig, "--out", out)
    assert refused.exit_code != 0
    assert "--force" in str(refused.exception)
    assert out.read_text() == "mine"
    assert run("excitation", rig, "--out", out, "--order", 5, "--force").exit_code == 0
    assert out.read_text().startswith("t,i_e.A_zeta")


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--out", "i_e.txt"), "no format"),
        (("--out", "i_e.csv", "--signal", "chirp"), "prbs or multisine"),
        (("--out", "i_e.csv", "--axes", "C_zeta"), "axes of the rig"),
        (("--out", "i_e.csv", "--signal", "multisine", "--band", "100"), "LOW:HIGH"),
        (("--out", "i_e.csv", "--signal", "multisine", "--amplitude", "0"), "--amplitude"),
        (("--out", "i_e.csv", "--signal", "multisine", "--periods", "0"), "--periods"),
        (("--out", "i_e.csv", "--amplitude", "nan"), "amplitude"),
        (("--out", "i_e.csv", "--travel", "0"), "travel"),
        (("--out", "i_e.wav", "--full-scale", "0.01"), "peak"),
    ],
)
def test_excitation_refuses(rig, tmp_path, monkeypatch, arguments, word):
    monkeypatch.chdir(tmp_path)
    ended = run("excitation", rig, *arguments)
    assert ended.exit_code != 0
    assert isinstance(ended.exception, ambid.AmbidError)
    assert word in str(ended.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
