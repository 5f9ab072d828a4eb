"""i_e rebuilt over random seeds."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from ambid.errors import RecordError
from ambid.excitation import prbs
from ambid.record import Record
from ambid.record.rebuild import rebuild_excitation
from ambid.rig import PidController, Rig, StateSpaceController
from places import BENCH as BENCH_FILE

RIG = Rig.load(BENCH_FILE)
AXES = RIG.axes
PID = {"proportional": 28000.0, "integral": 2e5, "derivative": 60.0, "derivative_time_constant": 1e-4}


def _closed_loop_signals(controller, rig, seed, delay=0):
    """i_e, y, i_ref and i_c for a smooth y that nobody calls closed-loop: K and the amplifier do not care.

    Analog: y is linear between the samples, and K and the amplifier are integrated 25 times finer.
    """
    rng = np.random.default_rng(seed)
    n, dt, tau = len(AXES), 1 / rig.sample_rate, rig.amplifier.time_constant
    i_e = prbs(7, amplitude=0.2, hold=4, axes=n, periods=4, seed=seed)
    i_e -= i_e.mean(axis=0)
    samples = len(i_e)
    y = lfilter([0.02], [1, -0.98], rng.normal(0, 5e-6, (samples, n)), axis=0)
    from_rest = np.minimum(np.arange(samples) / 50, 1.0)[:, None]
    y = from_rest * (y - np.sum(from_rest * y, axis=0) / from_rest.sum())
    fine = 1 if controller.is_digital else 25
    time = np.arange((samples - 1) * fine + 1) / fine
    y_fine = np.stack([np.interp(time, np.arange(samples), column) for column in y.T], axis=1)
    K = controller.state_space(n, rig.sample_rate)
    A, B, C, D = K if controller.is_digital else cont2discrete(K, dt / fine, method="bilinear")[:4]
    x, feedback = np.zeros(len(A)), np.empty_like(y_fine)
    for k, u in enumerate(y_fine):
        feedback[k] = C @ x + D @ u
        x = A @ x + B @ u
    i_ref = i_e[np.floor(time).astype(int)] - feedback
    i_ref = np.concatenate([np.zeros((delay, n)), i_ref[: len(i_ref) - delay]])
    a = np.exp(-dt / fine / tau)
    held = i_ref if fine == 1 else 0.5 * (i_ref[:-1] + (i_e[np.floor(time[:-1]).astype(int)] - feedback[1:]))
    i_c = lfilter([0, 1 - a], [1, -a], np.concatenate([held, held[-1:]])[: len(time)], axis=0)
    return i_e, y, i_ref[::fine], i_c[::fine]


def rebuilt(record, rig):
    """The record with i_e, as loading it with its rig makes it."""
    signals = {name: getattr(record, name) for name in ("y", "i_ref", "i_c")}
    return rebuild_excitation(rig, record.sample_rate, **signals)


DIGITAL = PidController(implementation="digital", delay_samples=2.0, **PID)
LEAD = StateSpaceController(implementation="analog", A=[[-1e4]], B=[[1e4]], C=[[-6e5]], D=[[6.28e5]])


@pytest.mark.parametrize("source", ["i_ref", "i_c"])
@pytest.mark.parametrize("controller", [RIG.controller, DIGITAL, LEAD], ids=["analog", "digital", "no integrator"])
def test_excitation_is_rebuilt(controller, source):
    rig = RIG.replace(controller=controller)
    i_e, y, i_ref, i_c = _closed_loop_signals(controller, rig, seed=3, delay=int(controller.delay_samples))
    offset = 1.5 if controller is RIG.controller else 0.0  # what the integrator holds against gravity
    given = {"i_ref": i_ref + offset} if source == "i_ref" else {"i_c": i_c + offset}
    record = Record("r", rig.sample_rate, AXES, None, y, **given)
    found = rebuilt(record, rig)
    error = found.i_e - i_e
    assert np.sqrt(np.mean(error**2)) < (1e-9 if controller.is_digital else 2e-3) * 0.2
    assert found.period == 127 * 4
    assert found.source == ("rebuilt_from_command" if source == "i_ref" else "rebuilt_from_current")
    assert (found.findings[0].code, found.findings[0].values["source"]) == ("excitation_rebuilt", source)


def test_rebuilt_excitation_tells_what_it_cannot_do(golden):
    i_e, y, i_ref, i_c = _closed_loop_signals(DIGITAL, RIG, seed=1)
    nothing = Record("r", RIG.sample_rate, AXES, None, y)
    with golden.raises(RecordError):
        rebuilt(nothing, RIG)
    faster = RIG.replace(controller=PidController(implementation="digital", sample_rate=20000.0, **PID))
    with pytest.raises(RecordError, match="20000 Hz"):
        rebuilt(Record("r", RIG.sample_rate, AXES, None, y, i_ref=i_ref), faster)
    with golden.raises(RecordError):
        rebuilt(Record("r", RIG.sample_rate, AXES, None, y + 1e-3, i_ref=i_ref), RIG)
    fractional = RIG.replace(controller=PidController(implementation="digital", delay_samples=1.4, **PID))
    found = rebuilt(Record("r", RIG.sample_rate, AXES, None, y, i_ref=i_ref), fractional)
    assert found.findings[0].values["delay_left_samples"] == pytest.approx(0.4)
    ideal = RIG.replace(amplifier={"time_constant": 0.0}, controller=DIGITAL.model_copy(update={"delay_samples": 0.0}))
    found = rebuilt(Record("r", RIG.sample_rate, AXES, None, y, i_c=i_ref), ideal)
    np.testing.assert_allclose(found.i_e, i_e, atol=1e-9)
