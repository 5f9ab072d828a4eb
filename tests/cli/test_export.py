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
    return own


def test_a_saved_model_becomes_a_file_and_a_script(model, command):
    found = command("export", "model.json", "--uss", "bench.mat", "--json", "told.json")
    assert (found.code, found.err) == (0, "")
    assert "written: bench.mat" in found.out
    assert "written: bench_uss.m" in found.out
    content = scipy.io.loadmat("bench.mat", squeeze_me=True)
    assert list(content["parameters"]) == ["K_i_A_zeta", "K_s_A_zeta", "tau_e"]
    np.testing.assert_allclose(content["nominal"], model.theta)
    assert "load('bench.mat')" in Path("bench_uss.m").read_text()
    told = json.loads(Path("told.json").read_text())
    assert told["parameters"]["tau_e"]["ci95"][0] == pytest.approx(model.theta[2] * (1.0 - 0.05 * 1.959964))
    assert command("export", "model.json", "--uss", "bench.mat").code == 2
    assert command("export", "model.json", "--uss", "bench.mat", "--force").code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["bare.json", "--uss", "bench.mat"], "no covariance"),
        (["model.json", "--uss", "bench.txt"], "the suffix is .txt; expected .mat"),
        (["none.json", "--uss", "bench.mat"], "none.json"),
    ],
)
def test_what_is_wrong_is_told(model, command, arguments, said):
    found = command("export", *arguments)
    assert found.code == 2
    assert said in found.err
    assert not Path("bench.mat").exists()
