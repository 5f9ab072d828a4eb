"""The law of a controller, from its recorded input and command, against levitators written from their physics."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Record, Rig, check
from ambid.checking import stops_diagnosis
from ambid.checking.law import find_laws
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 1000.0, (300.0, 900.0, 12.0)
LAW = "u = 300 e + 900 int e + 12 de/dt, de/dt behind a lag of 0.5 ms"
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)


def rig(gains=GAINS, of_current=0.0) -> Rig:
    own = {"kind": "state_space", "implementation": "digital", "reference": True}
    matrices = pid_matrices(*gains, RATE, of_current)
    if of_current:
        own["inputs"] = ["y", "i_c"]
    else:
        matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, own | matrices)


def run(of_current=0.0, limit=np.inf, noise=(1e-7, 1e-4), law=None) -> tuple[dict, np.ndarray]:
    r = np.repeat(2e-4 * np.random.default_rng(1).standard_normal(20), 100)
    law = law or pid(*GAINS, RATE, of_current)
    return TRUTH.run(RATE, law, r, 0.0 * r, noise=noise, limit=limit), r[:, None]


def record(own: Rig, **keys) -> Record:
    signals, r = run(**keys)
    return Record.from_arrays(**signals, r=r, sample_rate=RATE, axes=own.axes, rig=own)


def test_gains_of_a_pid_are_told_in_its_words():
    (law,) = find_laws(record(rig()), rig())
    assert law.text == LAW
    assert law.left < 1e-9
    assert law.rig_left < 1e-9


def test_wrong_gains_of_the_rig_are_seen_beside_the_law():
    own = rig((250.0, 900.0, 10.0))
    (law,) = find_laws(record(own), own)
    assert law.text == LAW
    assert law.rig_left > 0.01


def test_a_current_that_is_read_belongs_to_the_law():
    (law,) = find_laws(record(rig(of_current=0.4), of_current=0.4), rig(of_current=0.4))
    assert law.text == LAW.replace(",", " - 0.4 i_c,")


def test_a_clipped_command_leaves_the_law_alone_and_becomes_excitation():
    own = record(rig(), limit=0.05)
    (law,) = find_laws(own, rig())
    assert law.clipped > 0.01
    assert law.text == LAW
    assert np.ptp(own.i_e) > 0.05


def test_intervals_of_a_noisy_command_hold_the_gains():
    own = record(rig())
    noisy = replace(own, i_ref=own.i_ref + 1e-3 * np.random.default_rng(2).standard_normal(own.i_ref.shape))
    (law,) = find_laws(noisy, rig())
    for name, gain in zip(("e", "int e", "de/dt"), GAINS, strict=True):
        if name in law.gains:
            assert abs(law.gains[name] - gain) < 4.0 * law.std_error[name]
    assert {"e", "de/dt"} <= set(law.gains)


def test_check_prints_it_and_says_nothing_without_a_command():
    own = record(rig())
    found = check(rig(), [own])
    (law,) = found.laws["record"]
    assert law.line() in str(found)
    assert check(rig(), [replace(own, i_ref=None)]).laws == {}


@pytest.mark.parametrize("signal", ["y", "r"])
def test_noise_in_place_of_a_signal_follows_from_no_law(signal):
    own = record(rig())
    noise = np.random.default_rng(3).standard_normal(own.y.shape) * getattr(own, signal).std()
    assert find_laws(replace(own, **{signal: noise}), rig()) == ()


def filtered(lag: float):
    """A PID by Tustin's rule with a filtered derivative, by its difference equations."""
    (p, i, d), a = GAINS, 2.0 * lag * RATE
    before = total = change = 0.0

    def law(e: float, _: float) -> float:
        nonlocal before, total, change
        total += 0.5 * i * (e + before) / RATE
        change = ((a - 1.0) * change + 2.0 * d * RATE * (e - before)) / (a + 1.0)
        before = e
        return p * e + total + change

    return law


def pid_rig(lag: float, factor: float = 1.0, **keys) -> Rig:
    names = ("proportional", "integral", "derivative")
    gains = {name: factor * gain for name, gain in zip(names, GAINS, strict=True)}
    own = {"kind": "pid", "implementation": "digital", "reference": True, **gains, "derivative_time_constant": lag}
    return TRUTH.rig(RATE, own | keys)


@pytest.mark.parametrize("lag", [0.0002, 0.0015, 0.002])
def test_the_law_that_is_printed_is_the_machines_in_a_rig_file(lag):
    own = pid_rig(0.003)
    (law,) = find_laws(record(own, law=filtered(lag)), own)
    assert law.gains["lag"] == pytest.approx(lag, rel=1e-3)
    assert f"{1e3 * lag:g} ms" in law.text
    copied = pid_rig(law.gains["lag"], proportional=law.gains["e"], integral=law.gains["int e"])
    (again,) = find_laws(record(copied, law=filtered(lag)), copied)
    assert law.rig_left > 0.01
    assert again.rig_left < 1e-8


def test_a_record_that_begins_in_the_middle_of_something_follows_the_rig_no_less():
    own = pid_rig(0.002)
    signals, r = run(law=filtered(0.002))
    cut = {name: signal[137:] + (0.005 if name == "y" else 0.0) for name, signal in signals.items()}
    middle = Record.from_arrays(**cut, r=r[137:] + 0.005, sample_rate=RATE, axes=own.axes, rig=own)
    assert find_laws(middle, own)[0].rig_left < 1e-8


def of_command(soundness):
    return [found for found in soundness.findings if found.where.channel == "i_ref.A_zeta"]


def test_a_command_in_another_unit_is_an_error_that_says_the_factor_and_stops_nothing():
    own = record(pid_rig(0.002), law=filtered(0.002))
    volts = replace(own, i_ref=2.0 * own.i_ref)
    (found,) = of_command(check(pid_rig(0.002), [volts]))
    assert (found.code, found.severity) == ("command_scale", "error")
    assert not stops_diagnosis(found)
    assert found.values["factor"] == pytest.approx(2.0, rel=1e-3)
    assert found.values["mapping_factor"] == pytest.approx(0.5, rel=1e-3)
    assert not of_command(check(pid_rig(0.002), [own]))


def test_a_gain_that_differs_is_named_with_both_values():
    own = pid_rig(0.002, proportional=200.0)
    (found,) = of_command(check(own, [record(own, law=filtered(0.002))]))
    assert found.code == "control_law_differs"
    assert found.values["gains"] == {"proportional": pytest.approx(300.0, rel=1e-3)}
    assert found.values["rig_gains"] == {"proportional": pytest.approx(200.0, rel=1e-3)}
    assert not stops_diagnosis(found)


@pytest.mark.parametrize(("late", "delay"), [(0, 0), (0, 1), (1, 0), (1, 1), (2, 1)])
def test_the_law_and_the_delay_of_the_command_are_found_whatever_the_rig_says(late, delay, golden):
    own = pid_rig(0.002, delay_samples=delay)
    signals, r = run(law=filtered(0.002), noise=(1e-6, 1e-4))
    signals["i_ref"] = np.concatenate([np.repeat(signals["i_ref"][:1], late, axis=0), signals["i_ref"]])[: len(r)]
    (law,) = find_laws(Record.from_arrays(**signals, r=r, sample_rate=RATE, axes=own.axes, rig=own), own)
    assert (law.late, law.rig_late) == (late, delay)
    assert law.gains["e"] == pytest.approx(300.0, rel=1e-4)
    assert law.rig_left < 1e-6
    golden.holds(law.line().rpartition("of the command")[2])  # of the delay alone
