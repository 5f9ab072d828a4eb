"""On which side of the controller's delay a command was recorded, by i_c alone, over random loops simulated apart."""

import numpy as np
import pytest
from scipy.linalg import expm

from ambid import Rig
from ambid.record.command_delay import SURE, by_current
from places import LEVITATOR

RIG = Rig.load(LEVITATOR)


def loop(seed, samples=400, steps=4):
    """Delay in samples, rate, commands before and behind it, i_c and y: a mass whose coil may induce and saturate."""
    rng = np.random.default_rng(seed)
    rate, mass, gain, corner = 5000.0, 10.0 ** rng.uniform(-1, 1), 10.0 ** rng.uniform(1, 2), 2 * np.pi * 8.0
    tau, delay, stiffness = rng.choice([0.3, 1.0, 3.0]) / rate, int(rng.integers(1, 4)), mass * corner**2
    induced, limit = rng.choice([0.0, 0.3]) * gain * tau, rng.choice([np.inf, 0.2])
    rates = np.zeros((4, 4))
    rates[0, 1], rates[1, [0, 2]], rates[2, 1:] = 1.0, np.array([stiffness, gain]) / mass, [-induced, -1.0, 1.0]
    rates[2] /= tau
    step = expm(rates / rate / steps)
    p, d = (10.0 * mass * corner**2) / gain, 4.2 * mass * corner / gain
    exciting = 0.1 * np.repeat(rng.choice([-1.0, 1.0], samples), int(rng.integers(1, 30)))[:samples]
    x, queue, before, found = np.zeros(3), [0.0] * delay, 0.0, []
    for excited in exciting:
        y = x[0] + 1e-7 * rng.standard_normal()
        command, before = -(p * y + d * (y - before) * rate) + excited, y
        found.append((command, queue[-1], x[2] + 0.003 * rng.standard_normal(), y))
        applied, queue = float(np.clip(queue[-1], -limit, limit)), [command, *queue[:-1]]
        for _ in range(steps):
            x = step[:3, :3] @ x + step[:3, 3] * applied
    believed = tau * rng.choice([0.6, 1.0, 1.5])
    rig = RIG.replace(amplifier=RIG.amplifier.model_copy(update={"time_constant": believed}))
    return rig, rate, delay, *(column[:, None] for column in np.array(found).T)


@pytest.mark.parametrize("seeds", [12, pytest.param(120, marks=pytest.mark.slow)])
def test_i_c_tells_on_which_side_of_the_delay_a_command_stands(seeds):
    wrong = missed = 0
    for seed in range(seeds):
        rig, rate, delay, asked, applied, i_c, y = loop(seed)
        wrong += by_current(rig, rate, applied, i_c, y, delay)[1] > SURE
        missed += by_current(rig, rate, asked, i_c, y, delay)[1] < SURE
    assert wrong <= 0.01 * seeds
    assert missed <= 0.1 * seeds
