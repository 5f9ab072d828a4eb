"""The law of a controller, from its recorded input and command, against levitators written from their physics."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Record, Rig, check
from ambid.checking.law import find_laws
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 1000.0, (300.0, 900.0, 12.0)
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)


def rig(gains=GAINS, of_current=0.0) -> Rig:
    own = {"kind": "state_space", "implementation": "digital", "reference": True}
    matrices = pid_matrices(*gains, RATE, of_current)
    if of_current:
        own["inputs"] = ["y", "i_c"]
    else:
        matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, own | matrices)


def run(of_current=0.0, limit=np.inf, noise=(1e-7, 1e-4)) -> tuple[dict, np.ndarray]:
    r = np.repeat(2e-4 * np.random.default_rng(1).standard_normal(20), 100)
    return TRUTH.run(RATE, pid(*GAINS, RATE, of_current), r, 0.0 * r, noise=noise, limit=limit), r[:, None]


def record(own: Rig, **keys) -> Record:
    signals, r = run(**keys)
    return Record.from_arrays(**signals, r=r, sample_rate=RATE, axes=own.axes, rig=own)


def test_gains_of_a_pid_are_told_in_its_words():
    (law,) = find_laws(record(rig()), rig())
    assert law.text == "u = 300 e + 900 int e + 12 de/dt"
    assert law.left < 1e-9
    assert law.rig_left < 1e-9


def test_wrong_gains_of_the_rig_are_seen_beside_the_law():
    own = rig((250.0, 900.0, 10.0))
    (law,) = find_laws(record(own), own)
    assert law.text == "u = 300 e + 900 int e + 12 de/dt"
    assert law.rig_left > 0.01


def test_a_current_that_is_read_belongs_to_the_law():
    (law,) = find_laws(record(rig(of_current=0.4), of_current=0.4), rig(of_current=0.4))
    assert law.text == "u = 300 e + 900 int e + 12 de/dt - 0.4 i_c"


def test_a_clipped_command_leaves_the_law_alone_and_becomes_excitation():
    own = record(rig(), limit=0.05)
    (law,) = find_laws(own, rig())
    assert law.clipped > 0.01
    assert law.text == "u = 300 e + 900 int e + 12 de/dt"
    assert any("stands at" in note for note in own.notes)
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
    assert "law of A_zeta: u = 300 e" in repr(check(rig(), [own]))
    assert check(rig(), [replace(own, i_ref=None)]).laws == {}


@pytest.mark.parametrize("signal", ["y", "r"])
def test_noise_in_place_of_a_signal_follows_from_no_law(signal):
    own = record(rig())
    noise = np.random.default_rng(3).standard_normal(own.y.shape) * getattr(own, signal).std()
    assert find_laws(replace(own, **{signal: noise}), rig()) == ()
