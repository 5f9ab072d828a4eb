"""The uncertain model from the shell."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import ambid
from places import LEVITATOR


@pytest.fixture
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = ambid.Model(ambid.Rig.load(LEVITATOR))
    own.save("model.json", np.diag((0.05 * own.theta) ** 2))
    own.save("bare.json")
    own.save("vague.json", np.diag((1.0 * own.theta) ** 2))
    return own


def test_a_saved_model_becomes_a_file_and_a_script(model, command):
    found = command("export", "model.json", "--uss", "bench.mat", "--json", "told.json")
    assert (found.code, found.err) == (0, "")
    assert all(f"written: {name}" in found.out for name in ("bench.mat", "bench_uss.m"))
    content = scipy.io.loadmat("bench.mat", squeeze_me=True)
    assert list(content["parameters"]) == ["K_i_A_zeta", "K_s_A_zeta", "tau_e"]
    np.testing.assert_allclose(content["nominal"], model.theta)
    assert "load('bench.mat')" in Path("bench_uss.m").read_text()
    shown = json.loads(Path("told.json").read_text())
    assert shown["parameters"]["tau_e"]["ci95"][0] == pytest.approx(model.theta[2] * (1.0 - 0.05 * 1.959964))
    assert command("export", "model.json", "--uss", "bench.mat").code == 2
    assert command("export", "model.json", "--uss", "bench.mat", "--force").code == 0


@pytest.mark.parametrize("name", ["bare.json", "vague.json"])
def test_a_model_that_cannot_be_written_is_refused(model, command, name, refused):
    refused(command("export", name, "--uss", "bench.mat"), name)
    assert not Path("bench.mat").exists()


@pytest.mark.parametrize("arguments", [["model.json", "--uss", "bench.txt"], ["none.json", "--uss", "bench.mat"]])
def test_what_is_wrong_is_named(model, command, arguments):
    found = command("export", *arguments)
    assert found.code == 2
    assert {"bench.txt", "none.json"} & {word.rstrip(":") for word in found.err.split()}
    assert not Path("bench.mat").exists()


def test_a_saved_model_becomes_a_stepper_and_a_unit(model, command):
    found = command("export", "bare.json", "--stepper", "bench.stepper", "--json", "told.json")
    assert (found.code, found.err) == (0, "")
    assert json.loads(Path("told.json").read_text())["inputs"] == list(model.loop.inputs)
    assert command("export", "bare.json", "--stepper", "bench.stepper").code == 2
    assert command("export", "bare.json", "--stepper", "bench.stepper", "--force").code == 0
    assert command("export", "bare.json").code == 2
    assert command("export", "bare.json", "--fmu", "bench.zip").code == 2
    assert command("export", "bare.json", "--fmu", "bench.fmu", "--fmi", "4").code == 2
    assert not [path for path in Path().iterdir() if path.suffix in (".fmu", ".zip")]


def test_a_missing_library_is_told(model, command, monkeypatch, tmp_path, refused):
    monkeypatch.setattr("ambid.embedded.unit.NATIVE", tmp_path)
    refused(command("export", "bare.json", "--fmu", "bench.fmu"), prints=True)
    assert not Path("bench.fmu").exists()
