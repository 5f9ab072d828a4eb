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
    out, shown = tmp_path / f"i_e{suffix}", tmp_path / "told.json"
    ended = run("excitation", rig, "--out", out, "--order", 7, "--periods", 4, "--json", shown)
    assert ended.exit_code == 0, ended.output
    data = json.loads(shown.read_text())
    assert (data["period"], data["periods"], data["axes"][0]["i_e"]) == (254, 4, 0.1)
    assert ("full_scale" in data) == (suffix == ".wav")
    assert out.stat().st_size > 1000
    assert f"{data['axes'][0]['i_e']:.3g}" in ended.output


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


@pytest.fixture
def refused_by(golden):
    """Hold an error of ours with its text."""

    def hold(ended):
        assert ended.exit_code != 0
        assert isinstance(ended.exception, ambid.AmbidError)
        golden.holds(str(ended.exception).replace(", ".join(own.name for own in ambid.CATALOGUE), "<catalogue>"))

    return hold


@pytest.mark.parametrize(
    "arguments",
    [
        ("i_e.txt",),
        ("i_e.csv", "--signal", "chirp"),
        ("i_e.csv", "--axes", "C_zeta"),
        ("i_e.csv", "--signal", "multisine", "--band", "100"),
        ("i_e.csv", "--signal", "multisine", "--amplitude", "0"),
        ("i_e.csv", "--signal", "multisine", "--periods", "0"),
        ("i_e.csv", "--amplitude", "nan"),
        ("i_e.csv", "--travel", "0"),
        ("i_e.wav", "--full-scale", "0.01"),
    ],
    ids="_".join,
)
def test_excitation_refuses(rig, tmp_path, monkeypatch, arguments, refused_by):
    monkeypatch.chdir(tmp_path)
    refused_by(run("excitation", rig, "--out", *arguments))
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]


def test_design_tells_and_writes_what_it_found(rig, tmp_path):
    out, shown = tmp_path / "i_e.wav", tmp_path / "told.json"
    ended = run("design", rig, "--accuracy", "K_i=0.02%", "--seconds", 5, "--out", out, "--json", shown)
    assert ended.exit_code == 0, ended.output
    data = json.loads(shown.read_text())
    wanted = data["wanted"]["K_i.A_zeta"]
    assert 1.96 * data["parameters"]["K_i.A_zeta"]["std_error"] <= wanted == pytest.approx(0.036)
    assert 0.99 <= data["efficiency"] <= 1.0
    assert data["forecast"]["load"] <= 1.0 + 1e-9
    assert data["full_scale"] == pytest.approx(data["forecast"]["axes"][0]["i_e"])
    assert {"loop_delay", "sensor_lag"} <= {own["effect"] for own in data["effects"]}
    assert all(own["effect"] in ended.output for own in data["effects"])
    assert out.exists()


def test_design_takes_values_and_noise_from_a_record(rig, tmp_path):
    record, shown = tmp_path / "run.csv", tmp_path / "told.json"
    assert run("simulate", rig, "--out", record, "--seconds", 0.5, "--quiet").exit_code == 0
    ended = run("design", rig, "--record", record, "--signal", "prbs", "--seconds", 1, "--json", shown, "--quiet")
    assert ended.exit_code == 0, ended.output
    data = json.loads(shown.read_text())
    assert data["signal"] == "prbs"
    assert data["efficiency"] is None
    assert data["parameters"]["K_i.A_zeta"]["value"] != 180.0


def test_design_tells_what_a_load_cell_would_save_beside_a_record_without_one(rig, tmp_path, refused_by):
    record, shown = tmp_path / "run.csv", tmp_path / "told.json"
    assert run("simulate", rig, "--out", record, "--seconds", 0.5, "--quiet").exit_code == 0
    given = ("--record", record, "--channel", "f:0.3", "--signal", "prbs", "--seconds", 1)
    ended = run("design", rig, *given, "--exact", "--json", shown)
    assert ended.exit_code == 0, ended.output
    data = json.loads(shown.read_text())
    told = data["seconds_without"]["f"]
    assert told > data["seconds"]
    (finding,) = (own for own in data["findings"] if own["code"] == "further_signal_shortens")
    assert finding["values"]["without_s"] == told
    assert finding["message"] in ended.output
    refused_by(run("design", rig, "--record", record, "--sensor-noise", 1e-8))


@pytest.mark.slow
def test_diagnose_proposes_what_settles_an_ambiguous_verdict(rig, tmp_path):
    record, shown = tmp_path / "run.csv", tmp_path / "told.json"
    late = ("--amplitude", 0.5, "--effect", "loop_delay:delay=3e-5")
    assert run("simulate", rig, "--out", record, "--seconds", 0.5, *late, "--quiet").exit_code == 0
    lines = record.read_text().splitlines()
    kept = [k for k, name in enumerate(lines[0].split(",")) if not name.startswith("i_c")]
    record.write_text("\n".join(",".join(np.array(line.split(","))[kept]) for line in lines))
    ended = run("diagnose", rig, record, "--next", "--json", shown)
    assert ended.exit_code == 0, ended.output
    data = json.loads(shown.read_text())
    assert data["next_experiments"]["hypotheses"] == data["ambiguous_sets"][0]
    best = data["next_experiments"]["experiments"][0]
    assert "record i_c" in [own["change"] for own in data["next_experiments"]["experiments"]]
    assert f"{best['seconds']:.3g} s" in ended.output


def test_design_proposes_what_tells_effects_apart(rig, tmp_path):
    shown = tmp_path / "told.json"
    apart = ("--apart", "loop_delay:delay=1e-5", "--apart", "sensor_lag:time_constant=1e-5")
    ended = run("design", rig, "--without-currents", "--seconds", 1, *apart, "--json", shown)
    assert ended.exit_code == 0, ended.output
    following = json.loads(shown.read_text())["next_experiments"]
    assert following["hypotheses"] == ["loop_delay", "sensor_lag"]
    assert "record i_c" in {own["change"] for own in following["experiments"]}
    assert all(own["change"] in ended.output for own in following["experiments"])


@pytest.mark.parametrize(
    "arguments",
    [
        ("--accuracy", "K_i"),
        ("--accuracy", "K_i=much"),
        ("--effect", "no_such"),
        ("--apart", "loop_delay"),
        ("--signal", "chirp"),
        ("--sensor-noise", "0"),
        ("--peak", "-1"),
    ],
    ids="_".join,
)
def test_design_refuses(rig, tmp_path, monkeypatch, arguments, refused_by):
    monkeypatch.chdir(tmp_path)
    refused_by(run("design", rig, "--out", "i_e.csv", *arguments))
    assert [path.name for path in tmp_path.iterdir()] == ["rig.toml"]
