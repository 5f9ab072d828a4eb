"""Ctrl-C during a long call into the core. How much work may pass between two of its questions is tested in Rust."""

import json
import subprocess
import sys

import pytest

HANGS = 300.0
"""Seconds after which the child is taken to hang; all of it takes some."""
LONG = {
    "simulate": "lambda: (lambda u: loop.core.simulate(theta, u), np.ones((4_000_000, 4)))",
    "sensitivity": "lambda: (lambda u: loop.core.folded(theta, list(range(9)), u, 0, 100), np.ones((4_000_000, 4)))",
    "settled": "lambda: (lambda u: loop.core.settled(theta, [], u, 1), np.ones((2_000_000, 4)))",
    "lines of many records": "lambda: (lambda many: equations(many), [lines()] * 100)",
    "nonlinear": "lambda: (lambda u: bent.loop.core.simulate(bent.theta, u), np.full((2_000_000, 4), 0.01))",
    "stepper": "lambda: (lambda u: loop.simulator(theta).run(u), np.ones((2_000_000, 4)))",
    "noise": "lambda: (lambda m: _core.inverses(m), np.tile(np.eye(64, dtype=complex), (2_000, 1, 1)))",
}
"""A call and its argument; each takes a multiple of the time after which the signal comes."""
CHILD = """
import json, os, signal, threading
import numpy as np
import ambid
from ambid import _core
from ambid.demo import DATA

signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background inherits that it is ignored
model = ambid.Model(ambid.Rig.load(DATA / "rig.toml"))
loop, theta, bent = model.loop, model.theta, model.add("force_nonlinearity")

def lines():
    points, random = np.exp(1j * np.linspace(0.1, 3.0, 4_000)), np.random.default_rng(0)
    u, z = (random.standard_normal((len(points), n)).astype(complex) for n in (4, 8))
    return _core.LineData(loop.core, points, u, z, np.tile(np.eye(8, dtype=complex), (len(points), 1, 1)))

def equations(many):
    return _core.line_equations(loop.core, theta, list(range(9)), many)

def end(make):
    call, argument = make()
    call(argument[:1])  # everything is loaded and compiled
    threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        call(argument)
    except KeyboardInterrupt:
        return "interrupted"
    return "ran to its end"

print(json.dumps({name: end(make) for name, make in {CALLS}.items()}))
"""


@pytest.fixture(scope="module")
def ended():
    """How each of the calls ended, in one child."""
    calls = ", ".join(f"{name!r}: {make}" for name, make in LONG.items())
    source = CHILD.replace("{CALLS}", f"{{{calls}}}")
    child = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=HANGS)
    assert child.returncode == 0, child.stderr
    return json.loads(child.stdout)


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot send itself SIGINT")
@pytest.mark.parametrize("call", LONG)
def test_a_signal_ends_a_long_call(ended, call):
    assert ended[call] == "interrupted"
