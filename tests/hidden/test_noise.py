"""Noises and machines of the benchmarks: shaped sensor noise, a converter, long shafts, a third rotor."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid.excitation import prbs

from .bench import coloured, simulate
from .families import BENCHES
from .long import LONG
from .network import compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="hidden records need a C compiler (cc, gcc or clang)")
BENCH = BENCHES["bench"]
SHORT = prbs(7, amplitude=1.0, hold=3, axes=4, periods=2)


@pytest.mark.parametrize("denominator", [[1.0, -0.9], [1.0, -1.6, 0.96]])
def test_shaped_noise_keeps_its_rms(denominator):
    white = np.random.default_rng(1).standard_normal((200_000, 2))
    assert_allclose(coloured(white, [1.0], denominator)[1000:].std(axis=0), 1.0, rtol=0.03)


def test_shaped_noise_goes_round_the_loop():
    still = np.zeros_like(SHORT)
    white, slow = (simulate(BENCH.rig, still, **BENCH.truth, seed=3, colour=c) for c in (None, ([1.0], [1.0, -0.9])))
    steps = [np.diff(record.y, axis=0).std() / record.y.std() for record in (white, slow)]
    assert steps[1] < 0.6 * steps[0]


@pytest.mark.parametrize("implementation", ["analog", "digital"])
def test_a_converter_reads_whole_steps(implementation):
    rig = BENCH.rig.replace(controller=BENCH.rig.controller.model_copy(update={"implementation": implementation}))
    fine, read = (simulate(rig, SHORT, **BENCH.truth, seed=3, current_noise=0.0, adc_step=q) for q in (0.0, 1e-7))
    assert_allclose(read.y / 1e-7, np.rint(read.y / 1e-7), atol=1e-6)
    goes_round = not np.array_equal(fine.i_c, read.i_c)
    assert goes_round == (implementation == "digital")
    if not goes_round:
        assert np.abs(read.y - fine.y).max() <= 0.5e-7 * (1.0 + 1e-9)


@pytest.mark.parametrize("bench", [*LONG.values(), BENCHES["compressor"]], ids=[*LONG, "compressor"])
def test_machines_of_the_benchmarks_levitate(bench):
    axes = len(bench.rig.axes)
    for speed in (0.0, 400.0):
        i_e = prbs(7, amplitude=bench.amplitude, hold=2, axes=axes, periods=4)
        record = simulate(bench.rig.replace(speed=speed), i_e, **bench.truth, **bench.noise, seed=2)
        halves = np.split(record.y, 2)
        assert 0.5 < halves[1].std() / halves[0].std() < 1.5
        assert np.abs(record.y).max() < 0.3 * bench.rig.bearings[0].air_gap
