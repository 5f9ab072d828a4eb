"""Machines that a reference drives, simulated by something else than the product: lags, rates and excitations."""

import numpy as np
import pytest

from ambid import Record, diagnose, identify
from ambid.errors import RecordError
from reference.levitator import Levitator, pid, pid_matrices

MASS, K_S, K_I = 0.06, 95.0, 1.3
MACHINES = {
    "fast coil, 20 kHz": (20e3, 5e-4, (400.0, 2000.0, 8.0)),
    "slow coil, 1 kHz": (1e3, 0.03, (200.0, 300.0, 30.0)),
    "slow computer": (250.0, 2e-3, (250.0, 600.0, 7.0)),
}


def controller(gains, rate) -> dict:
    matrices = pid_matrices(*gains, rate)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return {"kind": "state_space", "implementation": "digital", "reference": True} | matrices


def drive(kind: str, samples: int, random) -> tuple[np.ndarray, np.ndarray]:
    """Reference and i_e of the kinds that people play."""
    hold = samples // 16
    still = np.zeros(samples)
    if kind == "stairs":
        return np.repeat(1e-4 * random.standard_normal(17), hold)[:samples], still
    if kind == "one step":
        return 2e-4 * (np.arange(samples) > samples // 4), still
    if kind == "noise":
        return 2e-5 * random.standard_normal(samples), still
    sweep = np.sin(2 * np.pi * (2.0 + 0.02 * np.arange(samples) / samples * samples) * np.arange(samples) / samples)
    return 1e-4 * sweep, 0.01 * random.standard_normal(samples)


def run(name: str, kind: str, truth: Levitator, seed: int = 0, **keys) -> tuple[dict, dict, float]:
    rate, tau, gains = MACHINES[name]
    samples = int(np.clip(4.0 * rate, 2000, 12000))
    r, i_e = drive(kind, samples, np.random.default_rng(seed))
    signals = truth.run(rate, pid(*gains, rate), r, i_e, noise=(1e-7, 1e-4), seed=seed, **keys)
    logged = {"i_e": i_e[:, None]} if i_e.any() else {}
    return {"y": signals["y"], "i_c": signals["i_c"], "r": r[:, None], **logged}, signals, rate


def loaded(truth: Levitator, name: str, signals: dict, off: float = 0.05, **more):
    rate, _, gains = MACHINES[name]
    rig = truth.rig(rate, controller(gains, rate), off)
    return rig, Record.from_arrays(**signals, **more, sample_rate=rate, axes=rig.axes, rig=rig)


@pytest.mark.parametrize("kind", ["stairs", "one step", "noise", "sweep and i_e"])
@pytest.mark.parametrize("name", MACHINES)
def test_parameters_lie_within_their_intervals(name, kind):
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1])
    signals, *_ = run(name, kind, truth)
    rig, record = loaded(truth, name, signals)
    found = identify(rig, record)
    assert found.is_adequate
    for parameter, value in {"K_i.A_zeta": K_I, "K_s.A_zeta": K_S}.items():
        own = found.parameters[parameter]
        assert abs(own.value - value) < 4.0 * own.std_error
        assert own.std_error < 0.1 * value


@pytest.mark.slow
def test_a_hidden_induced_voltage_is_among_those_named():
    name = "slow coil, 1 kHz"
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1], back_emf=2.0)
    signals, *_ = run(name, "noise", truth)
    rig, record = loaded(truth, name, signals)
    found = diagnose(rig, record)
    named = {effect for names in found.ambiguous_sets for effect in names} | set(found.effects)
    assert found.verdict in ("explained", "ambiguous")
    assert "back_emf" in named


def test_a_clipped_command_is_known_and_the_parameters_come_out():
    name = "slow coil, 1 kHz"
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1])
    signals, all_signals, _ = run(name, "stairs", truth, limit=1.0)
    rig, record = loaded(truth, name, signals, i_ref=all_signals["i_ref"])
    assert np.abs(all_signals["i_ref"]).max() == 1.0
    assert np.ptp(record.i_e) > 1.0
    found = identify(rig, record)
    for parameter, value in {"K_i.A_zeta": K_I, "K_s.A_zeta": K_S}.items():
        assert abs(found.parameters[parameter].value - value) < 4.0 * found.parameters[parameter].std_error


def test_a_reference_that_the_rig_does_not_know_of_is_told():
    name = "slow coil, 1 kHz"
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1])
    signals, *_ = run(name, "stairs", truth)
    rate, _, gains = MACHINES[name]
    deaf = truth.rig(rate, controller(gains, rate) | {"reference": False})
    with pytest.raises(RecordError, match="reference = true"):
        Record.from_arrays(**signals, sample_rate=rate, axes=deaf.axes, rig=deaf)
    excited = signals | {"i_e": 0.01 * np.random.default_rng(0).standard_normal(signals["y"].shape)}
    record = Record.from_arrays(**excited, sample_rate=rate, axes=deaf.axes, rig=deaf)
    assert record.r is None
    assert "reference_left_out" in {own.code for own in record.findings}


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".h5", ".parquet", ".tdms"])
def test_every_format_holds_the_reference(tmp_path, suffix):
    name = "slow computer"
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1])
    signals, *_ = run(name, "stairs", truth)
    rig, record = loaded(truth, name, signals)
    record.save(tmp_path / f"run{suffix}")
    again = Record.load(tmp_path / f"run{suffix}", rig)
    assert np.array_equal(again.r, record.r)
    assert np.array_equal(again.y, record.y)


def test_a_still_reference_is_no_excitation(golden):
    """What moved y is then not stated: the law of the controller, about a reference that stood, does not give it."""
    name = "slow computer"
    truth = Levitator(MASS, K_I, K_S, MACHINES[name][1])
    signals, *_ = run(name, "stairs", truth)
    still = signals | {"r": np.full_like(signals["r"], 0.01)}
    with golden.raises(RecordError):
        loaded(truth, name, still)
    with golden.raises(RecordError):
        loaded(truth, name, still | {"i_e": np.zeros_like(still["y"])})
