"""Poles and the Campbell diagram from the shell."""

import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid.demo import DATA
from places import LEVITATOR


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Rig files of one axis and of four, and models of the latter that are known to 1 %, at two speeds."""
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(LEVITATOR.read_text())
    Path("rig.toml").write_text((DATA / "rig.toml").read_text())
    rig = ambid.Rig.load("rig.toml")
    for speed in (0.0, 400.0):
        model = ambid.Model(rig.replace(speed=speed))
        model = model.with_theta(model.theta * np.linspace(1.0, 1.05, len(model.theta)))  # no two axes are alike
        model.save(f"at_{speed:.0f}.json", np.diag((0.01 * model.theta) ** 2))


def test_poles_are_told_with_their_uncertainty(here, command):
    found = command("poles", "rig.toml", "--model", "at_0.json", "--json", "p.json", "--plot", "p.png")
    assert (found.code, found.err) == (0, "")
    shown = json.loads(Path("p.json").read_text())
    own = ambid.pole_map(ambid.Model.load("at_0.json"))
    assert [complex(*entry["pole"]) for entry in shown["closed"]] == own.closed.tolist()
    assert np.array(shown["closed"][0]["covariance"]).shape == (2, 2)
    assert Path("p.png").stat().st_size > 10_000


def test_poles_before_stand_beside(here, command):
    found = command("poles", "rig.toml", "--model", "at_0.json", "--before", "at_0.json", "--json", "-")
    shown = json.loads(found.out)
    assert shown["before"]["closed"] == shown["closed"]


def test_models_of_single_speeds_are_held_against_the_diagram(here, command):
    measured = ("--measured", "at_0.json", "--measured", "at_400.json")
    found = command("campbell", "rig.toml", *measured, "--json", "c.json", "--plot", "c.png")
    assert (found.code, found.err) == (0, "")
    shown = json.loads(Path("c.json").read_text())
    assert {own["speed"] for own in shown["measured"]} == {0.0, 400.0}
    assert shown["speed"][-1] == pytest.approx(500.0)
    assert {"forward", "backward"} <= {own["whirl"] for own in shown["branches"]}
    assert all(f"{own['speed']:.4g}" in found.out for own in shown["critical"])
    assert Path("c.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("poles", "rig.toml", "--plot", "p.bmp"), "p.bmp"),
        (("campbell", "one.toml"), ""),
        (("campbell", "rig.toml", "--speeds", "100"), "--speeds 100"),
        (("campbell", "rig.toml", "--speeds", "100:50"), "--speeds 100:50"),
        (("campbell", "rig.toml", "--speeds", "0:1e9"), "--speeds 0:1e9"),
        (("campbell", "rig.toml", "--speeds=-5:1e3"), "--speeds -5:1e3"),
        (("campbell", "rig.toml", "--speeds", "0:nan"), "--speeds 0:nan"),
    ],
    ids=lambda value: "_".join(value) if isinstance(value, tuple) else "",
)
def test_what_is_wrong_is_told(here, command, arguments, named, refused):
    refused(command(*arguments), named)


def test_a_model_that_is_not_there_is_named(here, command):
    found = command("poles", "rig.toml", "--before", "none.json")
    assert found.code == 2
    assert "none.json" in found.err
