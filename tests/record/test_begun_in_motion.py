"""A record that begins in motion: its controller's states are not at rest, and are no excitation."""

import numpy as np
import pytest

from ambid import Model, Record, Rig, check, compare, identify
from ambid.excitation import prbs
from found import the
from reference.levitator import Law, Levitator

RATE, SAMPLES, CUT = 1000.0, 4000, 137
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
NOISE = (1e-6, 1e-4)


def matrices() -> dict[str, list[list[float]]]:
    """A PID with a filtered derivative, and behind it a second integrator: three states."""
    P, integral, D, second, a = 300.0, 900.0, 12.0, 3.0, 0.7
    rate_gain = D * RATE * (1.0 - a)
    C, D_ = np.array([integral, -rate_gain, 0.0]), P + rate_gain
    A = np.diag([1.0, a, 1.0])
    A[2] += C / RATE
    B = np.array([[1.0 / RATE], [1.0 - a], [D_ / RATE]])
    C[2] = second
    return {"A": A.tolist(), "B": B.tolist(), "C": [C.tolist()], "D": [[D_]]}


def rig() -> Rig:
    return TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital", "reference": True} | matrices())


def law(step: float = 0.0) -> Law:
    """The same, its command in steps of a converter."""
    A, B, C, D = (np.array(matrices()[name]) for name in "ABCD")
    x = np.zeros(3)

    def u(e: float, _: float) -> float:
        nonlocal x
        out = float((C @ x)[0] + D[0, 0] * e)
        x = A @ x + B[:, 0] * e
        return step * np.round(out / step) if step else out

    return u


def begun(i_e: np.ndarray, r: np.ndarray | None = None, *, step: float = 0.0, limit: float = np.inf) -> dict:
    """Signals after a cut, without i_e."""
    reference = np.zeros(len(i_e)) if r is None else r
    found = TRUTH.run(RATE, law(step), reference, i_e, noise=NOISE, limit=limit)
    found |= {} if r is None else {"r": r[:, None]}
    return {name: own[CUT:] for name, own in found.items()}


def loaded(own: dict) -> Record:
    return Record.from_arrays(**own, sample_rate=RATE, axes=("A_zeta",), rig=rig())


def square() -> np.ndarray:
    return 1e-4 * np.where(np.arange(SAMPLES) % 1000 < 500, 1.0, -1.0)


@pytest.mark.parametrize("step", [0.0, 2e-3], ids=["exact", "converter"])
def test_a_reference_alone_drives_it(step):
    own = begun(np.zeros(SAMPLES), square(), step=step)
    record = loaded(own)
    assert not np.any(record.i_e)
    assert record.period == 1000
    assert record.excitation_source == "assumed_zero"
    assert the(record, "command_follows_controller").values["reference"] == "r"
    assert compare(Model(rig()), record).is_adequate
    assert check(rig(), [record]).is_sound


def test_a_clipped_command_is_the_only_excitation():
    limit = 0.6 * np.abs(begun(np.zeros(SAMPLES), square())["i_ref"]).max()
    record = loaded(begun(np.zeros(SAMPLES), square(), limit=limit))
    at_limit = np.abs(record.i_ref[:, 0]) == limit
    i_e = record.i_e[:, 0] - np.median(record.i_e)
    assert 0.0 < at_limit.mean() < 0.2
    assert np.abs(i_e[~at_limit]).max() < 1e-9 * limit
    assert np.abs(i_e[at_limit]).min() > 0.0
    assert compare(Model(rig()), record).is_adequate


def excitations() -> dict[str, np.ndarray]:
    time = np.arange(SAMPLES)
    sequence = np.tile(prbs(7, amplitude=0.05, hold=4)[:, 0], SAMPLES // 508 + 1)[:SAMPLES]
    return {
        "held": sequence,
        "multisine": 0.05 * np.sum([np.sin(2 * np.pi * k * time / 500 + k**2) for k in range(1, 40)], axis=0) / 6.0,
        "noise": 0.05 * np.random.default_rng(5).standard_normal(SAMPLES),
        "slow": 0.5 * np.sin(2 * np.pi * 1.3 * time / SAMPLES),
        "steps": 0.1 * ((time > 1000) * 1.0 - 2.0 * (time > 2250)),
    }


@pytest.mark.parametrize("kind", list(excitations()))
def test_a_true_excitation_is_kept(kind):
    i_e = excitations()[kind]
    record = loaded(begun(i_e))
    own = i_e[CUT:]
    if kind in ("held", "multisine", "steps"):  # they hold, or repeat: nothing of them is taken
        off = record.i_e[:, 0] - own
        assert np.ptp(off) < 1e-6 * np.ptp(own)
    found = compare(Model(rig()), record)
    assert found.is_adequate
    assert identify(rig(), record).parameters["K_i.A_zeta"].std_error < 0.05 * TRUTH.K_i
