"""Margins from the shell: nominal of a rig, with probabilities of a model that was saved."""

import json
from pathlib import Path

import numpy as np
import pytest

import ambid
from places import LEVITATOR


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A rig file, and a model of it whose parameters are known to 5 %."""
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(LEVITATOR.read_text())
    model = ambid.Model(ambid.Rig.load("rig.toml"))
    model.save("model.json", np.diag((0.05 * model.theta) ** 2))


def test_a_rig_alone_has_nominal_margins(here, command):
    found = command("margins", "rig.toml", "--json", "margins.json")
    assert (found.code, found.err) == (0, "")
    shown = json.loads(Path("margins.json").read_text())
    assert [own["code"] for own in shown["findings"]] == ["no_covariance"]
    assert shown["findings"][0]["message"] in found.out
    assert shown["axes"]["A_zeta"]["sensitivity"]["value"] == pytest.approx(1.43, abs=0.01)
    assert shown["axes"]["A_zeta"]["sensitivity"]["ci95"] is None
    assert shown["zone"] == "A"


def test_a_model_has_intervals_probabilities_and_a_picture(here, command):
    arguments = ("margins", "rig.toml", "--model", "model.json", "--draws", 60, "--seed", 3)
    found = command(*arguments, "--at", "sensor", "--plot", "s.png", "--json", "-")
    assert (found.code, found.err) == (0, "")
    assert Path("s.png").stat().st_size > 10_000
    shown = json.loads(found.out)
    assert (shown["at"], shown["draws"], shown["seed"]) == ("sensor", 60, 3)
    own = shown["axes"]["A_zeta"]
    low, high = own["sensitivity"]["ci95"]
    assert low < own["sensitivity"]["value"] < high < own["sensitivity"]["worst"]
    assert sum(own["zone_probability"].values()) == pytest.approx(1.0)
    assert set(own["sensitivity"]["worst_at"]) == {"K_i.A_zeta", "K_s.A_zeta", "tau_e"}


@pytest.mark.parametrize(
    "arguments", [["--at", "amplifier"], ["--draws", "5"], ["--plot", "s.bmp"], ["--plot", "rig.toml"]], ids="_".join
)
def test_what_is_wrong_is_told(here, command, arguments, refused):
    refused(command("margins", "rig.toml", "--model", "model.json", *arguments), arguments[-1])


def test_an_unstable_loop_cannot_have_margins(here, command, refused):
    rig = ambid.Rig.load("rig.toml")
    ambid.Model(rig).with_values({"K_i.A_zeta": 1e-3}).save("weak.json")
    found = command("margins", "rig.toml", "--model", "weak.json")
    refused(found, code=1)
