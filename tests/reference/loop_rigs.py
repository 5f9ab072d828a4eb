"""Rigs of many kinds for the tests of the loop, with parameters and excitations that belong to them."""

from functools import cache

import numpy as np

import places
from ambid.loop.loop import Loop
from ambid.rig import Amplifier, Bearing, PidController, PointMassRotor, Rig

from .physical_loop import PhysicalLoop

BENCH = Rig.load(places.BENCH)
LEVITATOR = BENCH.replace(
    rotor=PointMassRotor(mass=2.0),
    bearings=[
        Bearing(
            name="M",
            axes=("zeta",),
            position=0.0,
            sensor_position=0.0,
            bias_current=2.0,
            air_gap=4e-4,
            force_current=100.0,
            force_displacement=4e5,
        )
    ],
    controller=BENCH.controller.model_copy(update={"proportional": 8e3, "derivative": 15.0, "integral": 1e5}),
)
DIGITAL = {"implementation": "digital", "delay_samples": 0.0}
OFF = {"proportional": 0.0, "integral": 0.0, "derivative": 0.0}


def rig(base=BENCH, tilts=(45.0, 45.0), speed=0.0, amplifier=2e-4, rotor=None, **controller) -> Rig:
    """A rig with some of its values changed; `rotor` and the rest are keys of these two tables."""
    bearings = [b.model_copy(update={"tilt": tilt}) for b, tilt in zip(base.bearings, tilts, strict=False)]
    return base.replace(
        bearings=bearings,
        speed=speed,
        amplifier=Amplifier(time_constant=amplifier),
        rotor=base.rotor.model_copy(update=rotor or {}),
        controller=PidController(**base.controller.model_dump(exclude_none=True) | controller),
    )


CROSSED = {"tilts": (30.0, 75.0), "speed": 600.0}
RIGS = {
    "analog": rig(),
    "analog, rotating": rig(**CROSSED),
    "analog, ideal amplifier": rig(amplifier=0.0),
    "analog, rigid rotor": rig(rotor={"flexible_modes": 0, "bending_frequencies_hz": None}, **CROSSED),
    "analog, one axis": rig(LEVITATOR),
    "digital": rig(**DIGITAL),
    "digital, delay 1, rotating": rig(amplifier=5e-5, **CROSSED, **DIGITAL | {"delay_samples": 1.0}),
    "digital, delay 1.5, twice the rate": rig(**CROSSED, **DIGITAL | {"delay_samples": 1.5, "sample_rate": 2e4}),
    "digital, delay 0.3, ideal amplifier": rig(amplifier=0.0, **DIGITAL | {"delay_samples": 0.3}),
    "digital, delay 0.5, one axis": rig(LEVITATOR, **DIGITAL | {"delay_samples": 0.5}),
}


def filled_by(machine: Rig, shared: bool = False) -> dict[str, int]:
    """Parameters K_i, K_s and tau_e of each axis; or, `shared`, a single tau_e."""
    n = len(machine.axes)
    indices = {"K_i": range(n), "K_s": range(n, 2 * n), "tau_e": [2 * n] * n if shared else range(2 * n, 3 * n)}
    return {f"{kind}.{axis}": k for kind in indices for axis, k in zip(machine.axes, indices[kind], strict=True)}


@cache
def loop_of(machine: Rig, shared: bool = False, noise: bool = False) -> Loop:
    return Loop(machine, filled_by(machine, shared), noise=noise)


def parameters(machine: Rig, shared: bool = False, spread: float = 0.1, seed: int = 1) -> np.ndarray:
    """The rig's own values, each off by at most the relative `spread`."""
    k_i = [k for bearing in machine.bearings for k in bearing.force_current]
    k_s = [k for bearing in machine.bearings for k in bearing.force_displacement]
    theta = np.array([*k_i, *k_s, *[machine.actuator.time_constant] * (1 if shared else len(k_i))])
    return theta * (1.0 + spread * np.random.default_rng(seed).uniform(-1.0, 1.0, len(theta)))


def excitation(machine: Rig, samples: int = 200, seed: int = 2) -> np.ndarray:
    """Independent random steps on every axis [A]."""
    return np.random.default_rng(seed).choice([-1.0, 1.0], (samples, len(machine.axes)))


def physical(machine: Rig, theta: np.ndarray, shared: bool = False) -> PhysicalLoop:
    """The reference at parameters of shape (parameters,) or (parameters, sets)."""
    values = np.asarray(theta).reshape(len(theta), -1)[list(filled_by(machine, shared).values())]
    return PhysicalLoop(machine, *np.split(values, 3))


def assert_close(actual, expected, tolerance) -> None:
    """Within `tolerance` of each channel's peak."""
    assert actual.shape == expected.shape
    peak = np.max(np.abs(expected), axis=0)
    assert np.all(peak > 0.0)
    assert np.max(np.abs(actual - expected) / peak) < tolerance
