"""The command `workbench`: it serves until it is stopped, and refuses what it cannot serve."""

import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import pytest

from ambid.demo import DATA

pytest.importorskip("uvicorn", reason="the workbench's server needs uvicorn")

FILES = (DATA / "rig.toml", DATA / "hidden_train.mat")


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_it_serves_until_a_signal_ends_it(number, code):
    program = [
        sys.executable,
        "-c",
        "from ambid.cli import main; main()",
        "workbench",
        *map(str, FILES),
        "--no-browser",
    ]
    path = os.pathsep.join(entry for entry in sys.path if entry)
    process = subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    address = process.stdout.readline().strip()
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address) as answer:
        assert b"ambid workbench" in answer.read()
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(address.rsplit("/", 2)[0] + "/")
    process.send_signal(number)
    _, said = process.communicate(timeout=30)
    assert process.returncode == code
    assert "what was not exported is gone" in said
    assert "Traceback" not in said


@pytest.mark.parametrize("port", [-1, 70000])
def test_a_port_that_cannot_be_is_refused(command, port):
    found = command("workbench", *FILES, "--no-browser", "--port", port)
    assert found.code == 2
    assert f"--port {port}" in found.err


def test_a_missing_package_is_named(command, monkeypatch):
    monkeypatch.setitem(sys.modules, "starlette", None)
    found = command("workbench", *FILES, "--no-browser")
    assert found.code == 2
    assert "pip install 'ambid[workbench]'" in found.err


def test_a_model_that_is_not_there_is_refused(command, tmp_path):
    found = command("workbench", *FILES, "--no-browser", "--model", tmp_path / "none.json")
    assert found.code == 2
    assert "none.json" in found.err
