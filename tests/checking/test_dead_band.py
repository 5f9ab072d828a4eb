"""A force that is dead about zero takes most of a small current: physics, and no other machine."""

import numpy as np
import pytest

from ambid import Record, check, diagnose
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 10_000.0, (12_000.0, 200_000.0, 18.0)
TAU = 3e-4


class Dead(Levitator):
    """`bias` is the current about zero up to which there is no force."""

    def force(self, i, s):
        return self.K_i * np.sign(i) * max(0.0, abs(i) - self.bias) + self.K_s * s

    def _further(self, x, u, duration, steps=10):
        position, speed, i = x
        hold = np.exp(-duration / steps / self.tau)
        for _ in range(steps):
            speed += duration / steps * self.force(i, position) / self.mass
            position += duration / steps * speed
            i = u + hold * (i - u)
        return np.array([position, speed, i])


def record(size, band):
    truth = Dead(mass=4.0, K_i=115.0, K_s=4e5, tau=TAU, gap=5e-4, bias=band)
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    rig = truth.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices, off=0.05)
    rig = rig.replace(bearings=[rig.bearings[0].model_copy(update={"bias_current": 2.0})])
    i_e = size * np.random.default_rng(3).standard_normal(4000)
    signals = truth.run(RATE, pid(*GAINS, RATE), 0.0 * i_e, i_e, noise=(5e-8, 2e-3))
    return rig, Record.from_arrays(
        y=signals["y"], i_c=signals["i_c"], i_e=i_e[:, None], sample_rate=RATE, axes=rig.axes, rig=rig
    )


def of_machine(soundness):
    """Findings that compare y with the nominal machine."""
    return {f.code for f in soundness.findings} & {"force_too_small", "plant_differs", "other_machine"}


@pytest.mark.parametrize("size", [0.05, 0.1, 0.2])
def test_it_is_told_as_physics_the_more_the_less_is_excited_and_stops_nothing(size):
    found = check(*record(size, 0.02))
    assert found.is_sound
    if size < 0.1:
        assert "force_too_small" in of_machine(found)
    assert not of_machine(check(*record(size, 0.0)))


def test_a_diagnosis_goes_on_and_tells_it_beside_its_verdict():
    rig, own = record(0.05, 0.02)
    found = diagnose(rig, own)
    (small,) = [f for f in check(rig, own).findings if f.code == "force_too_small"]
    assert found.verdict != "not_informative"
    assert small in found.findings
