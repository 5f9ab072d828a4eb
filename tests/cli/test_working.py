"""The command `workbench`: it serves until it is stopped, and refuses what it cannot serve."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest

from ambid.cli.working import GONE
from ambid.demo import DATA

pytest.importorskip("uvicorn", reason="the workbench's server needs uvicorn")

FILES = (DATA / "rig.toml", DATA / "hidden_train.mat")


def started(*options, **environment):
    """The process of the command, and the address that it prints."""
    code = "from ambid.cli import main; main()"
    program = [sys.executable, "-c", code, "workbench", *map(str, FILES), *options]
    path = os.pathsep.join(entry for entry in sys.path if entry)
    own = {**os.environ, "PYTHONPATH": path, **environment}
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=own)
    return process, process.stdout.readline().strip()


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_it_serves_until_a_signal_ends_it(number, code, tmp_path):
    """The address is opened in the browser."""
    opened = tmp_path / "opened"
    (tmp_path / "browser.py").write_text(f"import sys; open({str(opened)!r}, 'w').write(sys.argv[1])")
    process, address = started(BROWSER=f"{sys.executable} {tmp_path / 'browser.py'} %s")
    for _ in range(300):
        if opened.exists() and opened.read_text():
            break
        time.sleep(0.1)
    assert opened.read_text() == address
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address) as answer:
        assert b"<html" in answer.read()
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(address.rsplit("/", 2)[0] + "/")
    process.send_signal(number)
    out, said = process.communicate(timeout=30)
    assert process.returncode == code
    assert "K_i.A_zeta" in out
    assert GONE in said
    assert "Traceback" not in said


def test_json_tells_what_the_page_held_but_not_its_token(tmp_path):
    """A parameter is moved on the page; then the command is ended."""
    process, address = started("--no-browser", "--quiet", "--json", str(tmp_path / "w.json"))

    def asked(path, given=None):
        headers = {"Content-Type": "application/json", "Origin": address.rsplit("/", 2)[0]}
        data = None if given is None else json.dumps(given).encode()
        with urllib.request.urlopen(urllib.request.Request(address + path, data, headers)) as answer:
            return json.loads(answer.read())

    window = asked("windows", {})["window"]
    asked(f"windows/{window}/move", {"name": "tau_e", "value": 0.0005, "revision": 0})
    shown = asked(f"windows/{window}/view")
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=30)
    assert (process.returncode, out) == (130, "")
    text = (tmp_path / "w.json").read_text()
    assert address.split("/")[-2] not in text
    found = json.loads(text)
    assert (found["address"], found["stopped"]) == (address.rsplit("/", 2)[0] + "/", True)
    (held,) = found["windows"]
    assert held["effects"] == []
    assert held["parameters"]["tau_e"] == {"value": 0.0005, "unit": "s"}
    assert (held["misfit"], held["misfit_bound"]) == (shown["misfit"], shown["bound"])
    assert held["steps"] == ["start", "tau_e = 0.0005 s"]


def test_json_is_not_written_over_a_record(command):
    before = FILES[1].read_bytes()
    found = command("workbench", *FILES, "--no-browser", "--json", FILES[1])
    assert found.code == 2
    assert {"--json", "RECORD"} <= set(found.err.split())
    assert FILES[1].read_bytes() == before


@pytest.mark.parametrize("port", [-1, 70000])
def test_a_port_that_cannot_be_is_refused(command, port):
    found = command("workbench", *FILES, "--no-browser", "--port", port)
    assert found.code == 2
    assert f"--port {port}" in found.err


def test_a_port_that_is_taken_is_refused(command):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
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
