"""What a command advises is something that it can do."""

import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.demo import DATA

LOADS = sorted(DATA.glob("static_*.csv"))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_static_load_in_milliampere_is_not_to_be_vouched_for(command):
    head, *rows = LOADS[0].read_text().splitlines()
    columns = head.split(",")
    first = next(k for k, name in enumerate(columns) if name.startswith("i_c."))
    lines = [row.split(",") for row in rows]
    text = [",".join([*own[:first], *(str(1e3 * float(cell)) for cell in own[first:])]) for own in lines]
    Path("mA.csv").write_text("\n".join([head, *text]))
    result = command("static-load", DATA / "rig.toml", "mA.csv")
    assert result.code == 2
    assert "it looks like mA; give ampere" in result.err
    assert "--allow" not in result.err


def test_static_load_names_its_own_option(command):
    result = command("static-load", DATA / "rig.toml", *LOADS, "--json", "s.json")
    assert result.code == 0
    assert "with --deflection and the nominal K_s" in result.out
    assert "deflection=True" not in result.out + Path("s.json").read_text()
    assert json.loads(Path("s.json").read_text())["notes"]


@pytest.mark.parametrize("job", ["identify", "diagnose", "rank", "workbench"])
def test_a_first_rig_without_records_is_refused_like_a_last_one(job, command):
    """The parameters of its bias current would have no record to be found from."""
    text = (DATA / "rig.toml").read_text()
    Path("6A.toml").write_text(text)
    Path("8A.toml").write_text(text)
    record = DATA / "prbs.mat"
    result = command(job, "6A.toml", "8A.toml", record)
    assert result.code == 2
    assert "6A.toml: no record follows" in result.err
    assert "begin with 8A.toml" in result.err
    assert "8A.toml: no record follows" in command(job, "6A.toml", record, "8A.toml").err


def test_what_is_not_identifiable_is_named_by_words_that_are_there(here, command):
    """A single tone does not tell three parameters apart; the message names a key of the JSON."""
    rig = ambid.Rig.load(here[0])
    mass = ambid.Model(rig)
    periods = np.tile(1e-3 * np.sin(2.0 * np.pi * np.arange(500) / 50.0)[:, None], (6, 1))
    mass.virtual_experiment(periods, seed=1, current_noise=1e-5, sensor_noise=1e-9).save("tone.csv")
    result = command("identify", here[0], "tone.csv", "--json", "e.json")
    assert result.code == 1
    found = json.loads(Path("e.json").read_text())
    assert found["status"] == "not_identifiable"
    assert "`not_identifiable`" in found["status_meaning"]
    assert found["not_identifiable"]
    assert "`directions`" not in result.out


def test_a_pattern_is_fixed_at_the_value_that_is_given(here, command):
    """It was kept at the start value instead."""
    command("identify", *here, "--fix", "K_i=150", "--json", "e.json")
    parameters = json.loads(Path("e.json").read_text())["parameters"]
    assert [p["value"] for name, p in parameters.items() if name.startswith("K_i")] == [150.0]
