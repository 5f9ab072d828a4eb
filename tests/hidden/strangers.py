"""Machines that nobody chose: rotor, bearings, controller, noises and excitation at random, until one is stable."""

import numpy as np

from ambid import Model
from ambid.errors import UnstableLoopError
from ambid.rig import (
    Actuator,
    Amplifier,
    Bearing,
    Disk,
    FiniteElementRotor,
    Material,
    PidController,
    Rig,
    Section,
    Tolerance,
)

from .families import SPEED, Bench

__all__ = ["stranger"]

TRIES = 200
"""Draws until a machine is stable."""
AIR_GAPS = (3e-4, 8e-4)
"""[m]"""
BIAS = (1.5, 5.0)
"""[A]"""
OFF = 0.12
"""Of the nominal K_i and K_s from the true ones, at the most."""


def stranger(number: int) -> Bench:
    """The machine of that number.

    Raises
    ------
    ValueError
        If none of the draws is stable.
    """
    random = np.random.default_rng([number, 41])
    for _ in range(TRIES):
        bench = _drawn(random)
        if _is_stable(bench):
            return bench
    raise ValueError(f"stranger {number}: no stable machine in {TRIES} draws")


def _drawn(random: np.random.Generator) -> Bench:
    def between(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.4g}")

    count = int(random.integers(4, 7))
    thick = between(0.03, 0.09)
    sections = [
        Section(length=between(0.05, 0.2), outer_diameter=float(f"{thick * between(0.7, 1.4):.4g}"))
        for _ in range(count)
    ]
    length = sum(section.length for section in sections)
    material = Material(density=7850.0, youngs_modulus=2.08e11, poisson_ratio=0.3)
    shaft = sum(np.pi / 4.0 * section.outer_diameter**2 * section.length for section in sections) * material.density
    disks = []
    for _ in range(int(random.integers(0, 3))):
        mass = shaft * between(0.05, 0.4)
        radius = thick * between(1.0, 2.5)
        polar = 0.5 * mass * radius**2
        place = float(random.choice([0.0, length, random.uniform(0.05, 0.95) * length]))
        disks.append(Disk(position=place, mass=mass, transverse_inertia=0.55 * polar, polar_inertia=polar))
    mass = shaft + sum(disk.mass for disk in disks)
    gap, bias = between(*AIR_GAPS), between(*BIAS)
    places = np.array([random.uniform(0.12, 0.3), random.uniform(0.7, 0.88)]) * length
    beside = random.choice([-1.0, 1.0], 2) * random.uniform(0.01, 0.04, 2)
    sensors = np.clip(places + beside, 0.0, length)
    # K_s s0 = K_i i0, and the rotor falls within some milliseconds
    K_s = np.array([0.5 * mass * between(150.0, 350.0) ** 2 for _ in places])
    K_i = K_s * gap / bias
    tilts = [float(tilt) for tilt in random.choice([0.0, 45.0, float(random.integers(0, 90))], 2)]
    bearings = [
        Bearing(
            name=name,
            position=float(place),
            sensor_position=float(sensor),
            tilt=tilt,
            bias_current=bias,
            air_gap=gap,
            force_current=float(f"{k_i:.3g}"),
            force_displacement=float(f"{k_s:.3g}"),
        )
        for name, place, sensor, tilt, k_i, k_s in zip("AB", places, sensors, tilts, K_i, K_s, strict=True)
    ]
    stiffness = K_s.mean() * between(0.6, 2.0)
    omega = np.sqrt(stiffness / (0.5 * mass))
    proportional = (stiffness + K_s.mean()) / K_i.mean()
    derivative = 2.0 * random.uniform(0.4, 0.9) * omega * 0.5 * mass / K_i.mean()
    rate = float(random.choice([5000.0, 8000.0, 10000.0, 16000.0, 20000.0]))
    digital = bool(random.random() < 0.5)
    amplifier, tau_e = between(2e-5, 1.5e-4), between(5e-5, 3e-4)
    rig = Rig(
        name="stranger",
        tolerance=Tolerance(exact=True),
        sample_rate=rate,
        rotor=FiniteElementRotor(
            flexible_modes=int(random.integers(1, 4)), modal_damping=between(0.002, 0.01),
            material=material, section=sections, disk=disks,
        ),
        bearing=bearings,
        amplifier=Amplifier(time_constant=amplifier),
        actuator=Actuator(time_constant=float(f"{tau_e * between(0.7, 1.5):.3g}")),
        controller=PidController(
            implementation="digital" if digital else "analog",
            proportional=float(f"{proportional:.4g}"),
            integral=float(f"{proportional * between(2.0, 20.0):.4g}"),
            derivative=float(f"{derivative:.4g}"),
            derivative_time_constant=float(f"{1.0 / (omega * between(8.0, 20.0)):.4g}"),
            **({"delay_samples": float(random.choice([0.0, 0.5, 1.0]))} if digital else {}),
        ),
    )  # fmt: skip
    order = int(random.integers(9, 11))
    periods = int(random.choice([3, 4, 6, 8]))
    hold = max(1, round(between(2e-4, 8e-4) * rate))
    axes = len(rig.axes)
    off = 1.0 + OFF * random.uniform(-1.0, 1.0, (2, axes))
    # a force of so much that the rotor moves by some per cent of the gap
    amplitude = float(f"{between(0.02, 0.08) * gap * stiffness / K_i.mean():.3g}")
    return Bench(
        rig=rig,
        K_i=tuple(np.repeat(K_i, 2) * off[0]),
        K_s=tuple(np.repeat(K_s, 2) * off[1]),
        tau_e=tau_e,
        hold=hold,
        periods=periods,
        amplitude=amplitude,
        middle=float(f"{random.uniform(0.4, 0.6) * length:.3g}"),
        order=order,
        sensor_noise=between(1e-4, 5e-4) * gap,
        current_noise=between(5e-4, 3e-3) * bias,
    )


def _is_stable(bench: Bench) -> bool:
    """With nominal and with true values, still and turning, with a margin."""
    for speed in (0.0, SPEED):
        model = Model(bench.rig.replace(speed=speed))
        true = {"tau_e": bench.tau_e}
        for name, values in (("K_i", bench.K_i), ("K_s", bench.K_s)):
            true |= {f"{name}.{axis}": value for axis, value in zip(bench.rig.axes, values, strict=True)}
        try:
            if min(model.decay_rate, model.with_values(true).decay_rate) < 2.0:
                return False
        except UnstableLoopError:
            return False
    return True
