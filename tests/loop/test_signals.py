"""Ctrl-C during a long call into the core."""

import subprocess
import sys

import pytest

SOON = 0.5
"""Seconds of the processor between the signal and the exception, on all its cores."""

READY = """
import os, signal, threading, time
import numpy as np
import ambid
from ambid.demo import DATA

signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background inherits that it is ignored
rig = ambid.Rig.load(DATA / "rig.toml")
model = ambid.Model(rig)
loop, theta, sent = model.loop, model.theta, []

def interrupt():
    sent.append(time.process_time())
    os.kill(os.getpid(), signal.SIGINT)

def go(call, argument):
    call(argument[:1])  # everything is loaded and compiled
    threading.Timer(0.1, interrupt).start()
    try:
        call(argument)
    except KeyboardInterrupt:
        print(time.process_time() - sent[0])
"""

LONG = {
    "simulate": "go(lambda u: loop.core.simulate(theta, u), np.ones((8_000_000, 4)))",
    "sensitivity": "go(lambda u: loop.core.folded(theta, list(range(9)), u, 0, 100), np.ones((8_000_000, 4)))",
    "settled": "go(lambda u: loop.core.settled(theta, u, 1), np.ones((6_000_000, 4)))",
    "lines of many records": """
points, random = np.exp(1j * np.linspace(0.1, 3.0, 20_000)), np.random.default_rng(0)
u, z = (random.standard_normal((len(points), n)).astype(complex) for n in (4, 8))
data = ambid._core.LineData(loop.core, points, u, z, np.tile(np.eye(8, dtype=complex), (len(points), 1, 1)))
go(lambda many: ambid._core.line_equations(loop.core, theta, list(range(9)), many), [data] * 100)
""",
    "nonlinear": """
bent = model.add("force_nonlinearity")
go(lambda u: bent.loop.core.simulate(bent.theta, u), np.full((3_000_000, 4), 0.01))
""",
    "stepper": "go(lambda u: loop.simulator(theta).run(u), np.ones((3_000_000, 4)))",
    "noise": "go(lambda m: ambid._core.inverses(m), np.tile(np.eye(64, dtype=complex), (4_000, 1, 1)))",
}
"""Each takes well above the tenth of a second after which the signal comes."""


@pytest.mark.skipif(sys.platform == "win32", reason="a process cannot send itself SIGINT")
@pytest.mark.parametrize("call", LONG)
def test_a_signal_ends_a_long_call(call):
    child = subprocess.run([sys.executable, "-c", READY + LONG[call]], capture_output=True, text=True, timeout=120)
    assert child.returncode == 0, child.stderr
    assert 0.0 < float(child.stdout) < SOON
