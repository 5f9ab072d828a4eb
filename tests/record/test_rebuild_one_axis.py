"""i_e of a levitator with a delay, rebuilt from what different people call its command, and from its current."""

import numpy as np
import pytest

from ambid import Model, Record, Rig, compare
from ambid.diagnosis import diagnose
from found import codes, the
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS, SAMPLES = 1000.0, (300.0, 900.0, 12.0), 3000
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
I_E = 0.02 * np.random.default_rng(4).standard_normal(SAMPLES)


def rig() -> Rig:
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital", "delay_samples": 1} | matrices)


def signals() -> dict[str, np.ndarray]:
    own, drives, waiting = pid(*GAINS, RATE), iter(I_E), [0.0]

    def delayed(e: float, i: float) -> float:
        waiting.append(own(e, i) - next(drives))
        return waiting.pop(0)

    return TRUTH.run(RATE, delayed, np.zeros(SAMPLES), np.zeros(SAMPLES), noise=(1e-6, 1e-4))


def record(**own) -> Record:
    return Record.from_arrays(**own, sample_rate=RATE, axes=rig().axes, rig=rig())


@pytest.mark.parametrize("is_before", [False, True], ids=["after the delay", "before the delay"])
def test_a_command_is_taken_as_it_was_recorded(is_before):
    own = signals()
    if is_before:
        own["i_ref"] = np.vstack([own["i_ref"][1:], own["i_ref"][-1:]])
    found = record(**own)
    middle = slice(10, -10)
    assert np.abs(found.i_e[middle, 0] - (I_E - I_E.mean())[middle]).max() < 1e-3 * I_E.std() + abs(I_E.mean())
    assert ("command_before_delay" in codes(found)) == is_before
    assert compare(Model(rig()), found).is_adequate


def test_a_current_that_gave_the_excitation_is_not_judged_beside_it():
    own = signals()
    found = record(y=own["y"], i_c=own["i_c"])
    assert found.channels == ["y.A_zeta"]
    assert "current_left_out" in codes(found)
    assert diagnose(rig(), found).verdict == "adequate"


def test_the_mean_of_what_is_rebuilt_has_the_unit_of_commands():
    own, found = rig(), signals()
    for resistance, unit in ((None, "A"), (2.0, "V")):
        amplifier = own.amplifier.model_copy(update={"resistance": resistance})
        of_unit = own.replace(amplifier=amplifier)
        taken = Record.from_arrays(
            y=found["y"], i_ref=found["i_ref"], sample_rate=of_unit.sample_rate, axes=of_unit.axes, rig=of_unit
        )
        assert the(taken, "excitation_rebuilt").values["unit"] == unit


@pytest.mark.parametrize(
    ("late", "stated", "code"),
    [(1, 1, "command_before_delay"), (0, 1, "controller_delay_not_seen"), (1, 2, "controller_delay_not_seen")],
    ids=["delayed", "at once", "delayed by less"],
)
def test_what_follows_a_command_that_the_law_makes_at_once_is_seen_by_the_current(late, stated, code):
    own, waiting = pid(*GAINS, RATE), [0.0] * late
    commands = []

    def law(e: float, i: float) -> float:
        commands.append(-own(e, i))
        waiting.append(commands[-1])
        return -waiting.pop(0)

    r = 2e-4 * np.repeat(np.random.default_rng(5).standard_normal(SAMPLES // 100), 100)
    found = TRUTH.run(RATE, law, r, np.zeros(SAMPLES), noise=(1e-6, 1e-4))
    as_stated = {"reference": True, "delay_samples": float(stated)}
    of_reference = rig().replace(controller=rig().controller.model_copy(update=as_stated))
    taken = Record.from_arrays(
        y=found["y"],
        i_c=found["i_c"],
        i_ref=np.array(commands)[:, None],
        r=r[:, None],
        sample_rate=RATE,
        axes=of_reference.axes,
        rig=of_reference,
    )
    assert taken.excitation_source == "assumed_zero"
    assert the(taken, code).values.get("seen_samples", late) == late
