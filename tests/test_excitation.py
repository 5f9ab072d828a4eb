"""Excitations against their closed forms; periods found and i_e rebuilt over random seeds."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from ambid.errors import InputError, RecordError
from ambid.excitation import find_period, multisine, prbs, rebuild_excitation
from ambid.record import Record
from ambid.rig import PidController, Rig, StateSpaceController
from places import BENCH as BENCH_FILE

RIG = Rig.load(BENCH_FILE)
AXES = RIG.axes
PID = {"proportional": 28000.0, "integral": 2e5, "derivative": 60.0, "derivative_time_constant": 1e-4}


@pytest.mark.parametrize("order", range(2, 17))
def test_prbs_is_a_maximum_length_sequence(order):
    length = 2**order - 1
    chips = prbs(order, amplitude=1.0, seed=order)[:, 0]
    assert chips.shape == (length,)
    assert abs(chips.sum()) == 1  # balance
    correlation = np.fft.irfft(np.abs(np.fft.rfft(chips)) ** 2, n=length) / length
    np.testing.assert_allclose(correlation, np.r_[1.0, np.full(length - 1, -1 / length)], atol=1e-11)


@pytest.mark.parametrize("order", [5, 9, 12])
def test_prbs_run_lengths(order):
    """Of 2^(n-1) runs, one in 2^k has length k; the two longest have n and n - 1 (Golomb's second postulate)."""
    chips = prbs(order, amplitude=1.0)[:, 0]
    chips = np.roll(chips, -np.flatnonzero(np.diff(chips))[0] - 1)
    runs = np.diff(np.r_[0, np.flatnonzero(np.diff(chips)) + 1, chips.size])
    expected = {k: 2 ** (order - 1 - k) for k in range(1, order - 1)} | {order - 1: 1, order: 1}
    assert {int(k): int(np.sum(runs == k)) for k in np.unique(runs)} == expected


def test_prbs_long_orders_have_their_length():
    assert prbs(20, amplitude=1.0).shape == (2**20 - 1, 1)
    assert find_period(prbs(17, amplitude=1.0, periods=2)) == 2**17 - 1


def test_prbs_shifts_holds_and_repeats():
    x = prbs(6, amplitude=0.3, hold=3, axes=4, periods=2, seed=5)
    assert x.shape == (2 * 63 * 3, 4)
    assert set(np.unique(x)) == {-0.3, 0.3}
    np.testing.assert_array_equal(x[:189], x[189:])
    np.testing.assert_array_equal(x[::3], x[2::3])
    for axis in range(4):
        np.testing.assert_array_equal(x[:189, axis], np.roll(x[:189, 0], 3 * (axis * 63 // 4)))
    np.testing.assert_array_equal(x, prbs(6, amplitude=0.3, hold=3, axes=4, periods=2, seed=5))
    shifted = prbs(6, amplitude=1.0, axes=2, shifts=[0, 10])
    np.testing.assert_array_equal(shifted[:, 1], np.roll(shifted[:, 0], 10))


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"order": 1}, "order"),
        ({"order": 25}, "24"),
        ({"order": 7.0}, "order"),
        ({"amplitude": 0.0}, "amplitude"),
        ({"amplitude": np.nan}, "amplitude"),
        ({"hold": 0}, "hold"),
        ({"axes": 0}, "axes"),
        ({"periods": -1}, "periods"),
        ({"axes": 2, "shifts": [1]}, "shifts"),
        ({"axes": 2, "shifts": [0.5, 1.5]}, "whole number"),
        ({"axes": 2, "shifts": [0, 127]}, "same signal"),
        ({"order": 2, "axes": 4}, "same signal"),
    ],
)
def test_prbs_refuses(arguments, word):
    with pytest.raises(InputError, match=word):
        prbs(**{"order": 7, "amplitude": 1.0} | arguments)


@pytest.mark.parametrize("phases", ["schroeder", "random"])
@pytest.mark.parametrize("period", [1000, 1001])
def test_multisine_has_power_on_its_lines_only(period, phases):
    lines = [3, 7, 8, 20, 111, 400]
    x = multisine(period, rms=0.2, lines=lines, axes=2, periods=3, phases=phases, seed=2)
    assert x.shape == (3 * period, 2)
    np.testing.assert_allclose(np.sqrt(np.mean(x**2, axis=0)), 0.2, rtol=1e-12)
    spectrum = np.abs(np.fft.rfft(x[:period], axis=0)) / period
    for axis in range(2):
        own = lines[axis::2]
        np.testing.assert_allclose(spectrum[own, axis], 0.2 * np.sqrt(2 / len(own)) / 2, rtol=1e-10)
        assert np.delete(spectrum[:, axis], own).max() < 1e-14


def test_multisine_band_and_crest_factor():
    x = multisine(10000, rms=1.0, band_hz=(10.0, 500.0), sample_rate=10000.0)[:, 0]
    excited = np.flatnonzero(np.abs(np.fft.rfft(x)) > 1e-6)
    np.testing.assert_array_equal(excited, np.arange(10, 501))
    assert np.abs(x).max() < 2.0  # rms is 1; random phases reach about 3.5
    random = multisine(10000, rms=1.0, band_hz=(10.0, 500.0), sample_rate=10000.0, phases="random")
    assert np.abs(random).max() > 2.5


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"lines": None}, "either"),
        ({"band_hz": (1.0, 2.0)}, "not both"),
        ({"lines": []}, "lines"),
        ({"lines": [0]}, "from 1"),
        ({"lines": [50]}, "below period / 2"),
        ({"lines": [3, 3]}, "once"),
        ({"lines": [1.5]}, "whole"),
        ({"rms": -1.0}, "rms"),
        ({"period": 2}, "period"),
        ({"phases": "zero"}, "schroeder"),
        ({"axes": 3}, "axes"),
        ({"lines": None, "band_hz": (1.0, 2.0)}, "sample_rate"),
        ({"lines": None, "band_hz": (1.0, 600.0), "sample_rate": 1000.0}, "band_hz"),
        ({"lines": None, "band_hz": (11.0, 12.0), "sample_rate": 1000.0}, "no line"),
    ],
)
def test_multisine_refuses(arguments, word):
    with pytest.raises(InputError, match=word):
        multisine(**{"period": 100, "rms": 1.0, "lines": [1, 2]} | arguments)


@pytest.mark.parametrize("seed", range(30))
def test_period_is_found(seed):
    """Any shift, any number of samples after the last whole period, exact or measured with noise below 1e-3."""
    rng = np.random.default_rng(seed)
    order, hold = rng.integers(4, 9), rng.integers(1, 6)
    period = (2**order - 1) * hold
    whole = prbs(int(order), amplitude=0.5, hold=int(hold), axes=3, periods=6, seed=seed)
    x = whole[rng.integers(0, period) :][: int(period * rng.uniform(2, 4.9))]
    assert find_period(x) == period
    assert find_period(x + rng.normal(0, 0.5 * 4e-4, x.shape)) == period
    assert find_period(x + rng.normal(0, 0.05, x.shape), tolerance=0.3) == period
    assert find_period(x + rng.normal(0, 0.05, x.shape)) is None


@pytest.mark.parametrize("seed", range(5))
def test_period_of_a_multisine(seed):
    rng = np.random.default_rng(seed)
    x = multisine(901, rms=0.3, lines=np.arange(1, 200), axes=4, periods=4, phases="random", seed=seed)[:3000]
    assert find_period(x) == 901
    assert find_period(x + rng.normal(0, 1e-4, x.shape)) == 901


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("lines", [range(1, 12), range(100, 140), range(40, 400, 3)], ids=["slow", "narrow", "odd"])
def test_period_in_noise(lines, seed):
    """A slow or narrow-band signal nearly repeats long before its period; noise of a quarter of it hides neither."""
    rng = np.random.default_rng(seed)
    x = multisine(2011, rms=0.2, lines=lines, axes=2, periods=6, phases="random", seed=seed)
    x = x[: rng.integers(4100, 12000)]
    assert find_period(x) == 2011
    noisy = find_period(x + rng.normal(0, 0.05, x.shape), tolerance=0.6)
    assert abs(noisy - 2011) <= (12 if lines[-1] < 20 else 1)


def test_period_common_to_different_axes():
    a = np.tile(prbs(4, amplitude=1.0)[:, 0], 40)[:600]
    b = np.tile(prbs(3, amplitude=0.1)[:, 0], 90)[:600]
    assert find_period(np.stack([a, b, np.zeros(600)], axis=1)) == 15 * 7
    assert find_period(a) == 15
    assert find_period(np.sin(2 * np.pi * np.arange(10000) / 2500)) == 2500


@pytest.mark.parametrize("seed", range(10))
def test_no_period(seed):
    rng = np.random.default_rng(seed)
    assert find_period(rng.choice([-1.0, 1.0], 5000)) is None
    assert find_period(rng.normal(size=5000).cumsum()) is None
    assert find_period(prbs(9, amplitude=1.0, periods=2)[:1000]) is None  # not quite two periods
    assert find_period(np.sin(np.linspace(0, 100, 4000) ** 2 / 10)) is None
    assert find_period(np.ones((500, 2))) is None


def _closed_loop_signals(controller, rig, seed, delay=0):
    """i_e, y, i_ref and i_c for a smooth y that nobody calls closed-loop: K and the amplifier do not care.

    Analog: y is linear between the samples, and K and the amplifier are integrated 50 times finer.
    """
    rng = np.random.default_rng(seed)
    n, dt, tau = len(AXES), 1 / rig.sample_rate, rig.amplifier.time_constant
    i_e = prbs(7, amplitude=0.2, hold=4, axes=n, periods=4, seed=seed)
    i_e -= i_e.mean(axis=0)
    samples = len(i_e)
    y = lfilter([0.02], [1, -0.98], rng.normal(0, 5e-6, (samples, n)), axis=0)
    from_rest = np.minimum(np.arange(samples) / 50, 1.0)[:, None]
    y = from_rest * (y - np.sum(from_rest * y, axis=0) / from_rest.sum())
    fine = 1 if controller.is_digital else 50
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
    rebuilt = rebuild_excitation(record, rig)
    error = rebuilt.i_e - i_e
    assert np.sqrt(np.mean(error**2)) < (1e-9 if controller.is_digital else 2e-3) * 0.2
    assert rebuilt.period == 127 * 4
    assert any("rebuilt from" in note and source in note for note in rebuilt.notes)
    assert record.i_e is None


def test_rebuilt_excitation_tells_what_it_cannot_do():
    i_e, y, i_ref, i_c = _closed_loop_signals(DIGITAL, RIG, seed=1)
    nothing = Record("r", RIG.sample_rate, AXES, None, y)
    with pytest.raises(RecordError, match="i_ref and i_c"):
        rebuild_excitation(nothing, RIG)
    faster = RIG.replace(controller=PidController(implementation="digital", sample_rate=20000.0, **PID))
    with pytest.raises(RecordError, match="20000 Hz"):
        rebuild_excitation(Record("r", RIG.sample_rate, AXES, None, y, i_ref=i_ref), faster)
    with pytest.raises(RecordError, match="set point"):
        rebuild_excitation(Record("r", RIG.sample_rate, AXES, None, y + 1e-3, i_ref=i_ref), RIG)
    fractional = RIG.replace(controller=PidController(implementation="digital", delay_samples=1.4, **PID))
    rebuilt = rebuild_excitation(Record("r", RIG.sample_rate, AXES, None, y, i_ref=i_ref), fractional)
    assert "0.4 sample" in rebuilt.notes[-1]
    ideal = RIG.replace(amplifier={"time_constant": 0.0}, controller=DIGITAL.model_copy(update={"delay_samples": 0.0}))
    rebuilt = rebuild_excitation(Record("r", RIG.sample_rate, AXES, None, y, i_c=i_ref), ideal)
    np.testing.assert_allclose(rebuilt.i_e, i_e, atol=1e-9)
