"""Outputs that are recorded late or early by any time, against an independent simulation and transforms."""

import numpy as np
import pytest

import ambid
from ambid.effects.channels import ChannelDelay
from ambid.effects.sensor import SamplingSkew
from hidden.bench import simulate
from hidden.families import BENCHES

SAMPLES = (0.1, 0.5, 1.0, 1.3, 7.6)
BOTH = (*SAMPLES, *(-samples for samples in SAMPLES))
BESIDE = {
    "alone": ({}, {}),
    "a late command": ({"loop_delay": {"seconds": 0.4}}, {"loop_delay": {"delay": 0.4}}),
    "a nonlinear force": ({"force_nonlinearity": {}}, {"force_nonlinearity": {"bias_ratio": 1.0}}),
}
"""Hidden physics and effects beside a late reading; times in samples."""
EXACT = {
    ("bench", "alone"): 1e-12,
    ("bench", "a late command"): 3e-5,  # the feedback of an analog controller passes an approximant
    ("bench", "a nonlinear force"): 1e-6,
    ("compressor", "alone"): 1e-12,
    ("compressor", "a late command"): 1e-12,
    ("compressor", "a nonlinear force"): 1e-6,
}


LATE = {
    "y": (ChannelDelay("y"), "delay", 1.0),
    "i_c": (SamplingSkew(), "current_late", -1.0),
    "i_e": (ChannelDelay("i_e"), "delay", 1.0),
}
"""What records each channel late, by which parameter, and its sign."""


class Machine:
    """A bench, how long its samples are, and its model at the truth with effects whose times are in samples."""

    def __init__(self, name, effects=()):
        bench = BENCHES[name]
        self.truth = {"K_i": bench.K_i, "K_s": bench.K_s, "tau_e": bench.tau_e}
        self.rig, self.sample = bench.rig, 1.0 / bench.rig.sample_rate
        self.i_e = ambid.prbs(6, amplitude=bench.amplitude, hold=2, axes=4, periods=2)
        values = {
            f"{k}.{axis}": v for k in ("K_i", "K_s") for axis, v in zip(self.rig.axes, self.truth[k], strict=True)
        }
        self.model = ambid.Model(self.rig).with_values({**values, "tau_e": bench.tau_e})
        for effect, own in dict(effects).items():
            self.model = self.model.add(effect, self.in_seconds(own, "delay"))

    def in_seconds(self, values, *times):
        return {key: value * self.sample if key in times else value for key, value in values.items()}

    def read(self, hidden, seconds):
        """What the independent machine gives with i_c read by so many seconds after y."""
        hidden = {name: self.in_seconds(own, "seconds") for name, own in hidden.items()}
        hidden["sampling_skew"] = {"seconds": seconds}
        return simulate(self.rig, self.i_e, hidden, seed=None, longest_step=self.sample / 20.0, **self.truth)

    def with_late_current(self, samples):
        return self.model.add("sampling_skew", {"current_late": samples * self.sample})


def largest_error(found, expected):
    """Of y and i_c, relative to the peak of each signal."""
    pairs = ((found.y, expected.y), (found.i_c, expected.i_c))
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs)


@pytest.mark.parametrize("samples", BOTH)
@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("name", ["bench", "compressor"])
def test_i_c_is_read_late_and_early_by_any_time(name, beside, samples):
    hidden, effects = BESIDE[beside]
    machine = Machine(name, effects)
    truth = machine.read(hidden, samples * machine.sample)
    assert largest_error(machine.with_late_current(samples).simulate(machine.i_e), truth) < EXACT[name, beside]
    assert largest_error(machine.model.simulate(machine.i_e), truth) > 0.01, "a late reading must show"


@pytest.mark.parametrize(("early", "late"), [(0.3, 0.1), (0.3, 0.4), (2.3, -0.7)])
def test_y_that_is_read_early_is_a_late_command(early, late):
    machine = Machine("compressor")
    values = {"current_late": late * machine.sample, "displacement_early": early * machine.sample}
    model = machine.model.add(SamplingSkew(moves_y=True), values)
    truth = machine.read({"loop_delay": {"seconds": early}}, (early + late) * machine.sample)
    assert largest_error(model.simulate(machine.i_e), truth) < 1e-12
    for name in values:
        assert error_of_slope(machine, model, f"sampling_skew.{name}") < 1e-6


def test_what_is_read_when_a_command_comes_to_act_is_read_behind_it():
    """Without any delay, where the slope by a late reading jumps: it is that of a later one."""
    machine = Machine("compressor")
    model = machine.model.add(SamplingSkew(moves_y=True), {"current_late": 0.0, "displacement_early": 0.0})
    (k,) = model.index(["sampling_skew.current_late"])
    y, slopes = model.loop.sensitivity(model.theta, machine.i_e, [k])[:2]
    theta = model.theta.copy()
    theta[k] = 1e-6 * machine.sample
    expected = (model.loop.simulate(theta, machine.i_e) - y) / theta[k]
    assert np.abs(slopes[:, :, 0] - expected).max() < 1e-4 * np.abs(expected).max()


def error_of_slope(machine, model, name):
    """Of a derivative by a time against central differences, relative to its peak."""
    (k,) = model.index([name])
    found = model.loop.sensitivity(model.theta, machine.i_e, [k])[1][:, :, 0]
    step = np.zeros(len(model.theta))
    step[k] = 1e-4 * machine.sample
    ahead, behind = (model.loop.simulate(model.theta + sign * step, machine.i_e) for sign in (1.0, -1.0))
    expected = (ahead - behind) / (2.0 * step[k])
    return np.abs(found - expected).max() / np.abs(expected).max()


@pytest.mark.parametrize("samples", [0.1, 0.55, 1.3, 7.6, -0.45, -7.7])
@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("name", ["bench", "compressor"])
def test_slopes_by_a_late_reading(name, beside, samples):
    machine = Machine(name, BESIDE[beside][1])
    model = machine.with_late_current(samples)
    tolerance = 5e-6 if beside == "a nonlinear force" else 1e-7
    assert error_of_slope(machine, model, "sampling_skew.current_late") < tolerance
    if beside == "a late command":
        assert error_of_slope(machine, model, "loop_delay.delay") < tolerance


@pytest.mark.parametrize("samples", [0.3, 2.3, -2.7])
@pytest.mark.parametrize("beside", ["alone", "a late command"])
@pytest.mark.parametrize("name", ["bench", "compressor"])
def test_lines_of_a_stretch_of_a_late_record(name, beside, samples):
    """Of a random excitation, from the middle of a run: what is late brings samples of before or behind the stretch."""
    machine = Machine(name, BESIDE[beside][1])
    model, length = machine.with_late_current(samples), 400
    core, theta, late = model.loop.core, model.theta, len(model.theta) - 1
    u = np.random.default_rng(0).standard_normal((3 * length, 4))
    y = model.loop.simulate(theta, u)
    points = np.exp(2j * np.pi * np.arange(length // 2) / length)

    def lines_of(signal):
        own = np.fft.fft(signal[length : 2 * length], axis=0)[: length // 2]
        return np.ascontiguousarray(own) / np.sqrt(length)

    measured, inputs = lines_of(y), lines_of(u)
    response, _, basis = core.lines(theta, [], points, inputs, None, True)
    table = basis.reshape(-1, basis.shape[2])
    table, left = np.vstack([table.real, table.imag]), (measured - response).ravel()
    size = np.linalg.norm(table, axis=0)
    size[size == 0.0] = 1.0
    d = np.linalg.lstsq(table / size, np.concatenate([left.real, left.imag]), rcond=1e-14)[0] / size
    found, slopes, _ = core.lines(theta, [late], points, inputs, d, False)
    assert np.abs(found - measured).max() < 1e-11 * np.abs(measured).max()

    step = np.zeros(len(theta))
    step[late] = 1e-5 * machine.sample
    moved = [core.lines(theta + sign * step, [], points, inputs, d, False)[0] for sign in (1.0, -1.0)]
    expected = (moved[0] - moved[1]) / (2.0 * step[late])
    assert np.abs(slopes[:, :, 0] - expected).max() < 1e-7 * np.abs(expected).max()

    around = core.transfer(theta, np.exp(2j * np.pi * np.arange(length) / length))
    periodic = np.einsum("lyu,lu->ly", around, np.fft.fft(u[length : 2 * length], axis=0))
    in_time = np.fft.ifft(periodic, axis=0).real + core.free_response(theta, d, length, length)
    assert np.abs(in_time - y[length : 2 * length]).max() < 1e-11 * np.abs(y).max()


@pytest.mark.parametrize("samples", [0.4, 2.3, -2.6])
@pytest.mark.parametrize("name", ["bench", "compressor"])
def test_the_frequency_response_of_a_late_record(name, samples):
    machine = Machine(name)
    f = np.array([20.0, 150.0, 400.0])
    on_time, late = (m.loop.frequency_response(m.theta, f) for m in (machine.model, machine.with_late_current(samples)))
    np.testing.assert_allclose(late[:, :4], on_time[:, :4], rtol=1e-9)
    if not machine.rig.controller.is_digital:
        expected = on_time[:, 4:] * np.exp(2j * np.pi * f * samples * machine.sample)[:, None, None]
        np.testing.assert_allclose(late[:, 4:], expected, rtol=1e-9)
        return
    model = machine.with_late_current(samples)
    expected = model.loop.transfer(model.theta, np.exp(2j * np.pi * f * machine.sample))
    assert np.abs(late - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("samples", [0.4, 2.3])
def test_slopes_of_a_late_frequency_response(samples):
    machine = Machine("bench")
    model = machine.with_late_current(samples)
    f, u = np.array([20.0, 150.0, 400.0]), np.ones((3, 4), dtype=complex)
    late, step = len(model.theta) - 1, np.zeros(len(model.theta))
    found = model.loop.frequency_slopes(model.theta, f, u, [late])[:, :, 0]
    step[late] = 1e-4 * machine.sample
    moved = [model.loop.frequency_response(model.theta + sign * step, f) @ np.ones(4) for sign in (1.0, -1.0)]
    expected = (moved[0] - moved[1]) / (2.0 * step[late])
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("samples", [-0.6, -2.6])
@pytest.mark.parametrize("beside", BESIDE)
def test_steps_of_a_late_record(beside, samples):
    """i_c of before is known; what is yet to come is not."""
    machine = Machine("bench", BESIDE[beside][1])
    model = machine.with_late_current(samples)
    expected = model.loop.simulate(model.theta, machine.i_e)
    simulator = model.simulator()
    tolerance = 1e-5 if beside == "a nonlinear force" else 1e-10
    for _ in range(2):
        assert np.abs(simulator.run(machine.i_e) - expected).max() < tolerance * np.abs(expected).max()
        simulator.reset()


def test_what_is_yet_to_come_cannot_be_stepped(golden):
    with golden.raises(ambid.errors.ModelError):
        Machine("bench").with_late_current(1.5).simulator()


@pytest.mark.parametrize("samples", [-0.6, -2.6])
@pytest.mark.parametrize("name", ["bench", "compressor"])
def test_the_state_space_of_a_late_record(name, samples):
    machine = Machine(name)
    model = machine.with_late_current(samples)
    A, B, C, D = model.loop.state_space(model.theta)
    x, rows = np.zeros(len(A)), []
    for u in machine.i_e[:60]:
        rows.append(C @ x + D @ u)
        x = A @ x + B @ u
    expected = model.loop.simulate(model.theta, machine.i_e[:60])
    np.testing.assert_allclose(rows, expected, atol=1e-10 * np.abs(expected).max())


def test_what_is_yet_to_come_has_no_state_space(golden):
    model = Machine("bench").with_late_current(1.5)
    with golden.raises(ambid.errors.ModelError):
        model.loop.state_space(model.theta)


@pytest.mark.parametrize("tenths", [1, 5, 13, 76, -5, -13, -76])
@pytest.mark.parametrize("channel", LATE)
def test_any_channel_is_late(channel, tenths):
    """Against the same analog loop at ten times the sample rate, its excitation held as long."""
    machine = Machine("bench")
    effect, parameter, sign = LATE[channel]
    model = machine.model.add(effect, {parameter: sign * 0.1 * tenths * machine.sample})
    found = model.loop.simulate(model.theta, machine.i_e)
    quick = ambid.Model(machine.rig.replace(sample_rate=10.0 * machine.rig.sample_rate))
    quick = quick.with_values({p.name: p.value for p in machine.model.parameters})
    before, after = np.zeros((1000, 4)), np.repeat(machine.i_e, 10, axis=0)
    fine = quick.loop.simulate(quick.theta, np.vstack([before, after, before]))
    rows = len(before) + 10 * np.arange(len(machine.i_e))
    expected = fine[rows]
    late = {"y": slice(0, 4), "i_c": slice(4, 8), "i_e": slice(0, 8)}[channel]
    expected[:, late] = fine[rows - (-tenths if channel == "i_e" else tenths)][:, late]
    assert (np.abs(found - expected).max(axis=0) < 1e-11 * np.abs(expected).max(axis=0)).all()
