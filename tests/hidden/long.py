"""Long shafts in four and in eight bearings: machines of eight and of sixteen axes."""

import numpy as np

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

from .families import Bench

PITCH = 0.3  # m from one bearing to the next
STEEL = Material(density=7850.0, youngs_modulus=2.1e11, poisson_ratio=0.3)


def long_rig(bearings: int, K_i: np.ndarray, K_s: np.ndarray, tau_e: float) -> Rig:
    """A shaft of `bearings` equal bays, a bearing and a disk in each, with these nominal values per axis."""
    half, quarter = 0.5 * PITCH, 0.25 * PITCH
    sections = [Section(length=quarter, outer_diameter=0.09 if k % 4 in (1, 2) else 0.08) for k in range(4 * bearings)]
    return Rig(
        name=f"shaft in {bearings} bearings",
        sample_rate=1e4,
        rotor=FiniteElementRotor(
            flexible_modes=bearings,
            modal_damping=0.01,
            material=STEEL,
            section=sections,
            disk=[
                Disk(position=k * PITCH + 3.0 * quarter, mass=4.0, transverse_inertia=0.01, polar_inertia=0.018)
                for k in range(bearings)
            ],
        ),
        bearing=[
            Bearing(
                name=chr(ord("A") + k),
                position=k * PITCH + half,
                sensor_position=k * PITCH + half + 0.02 * (-1) ** k,
                tilt=45.0,
                bias_current=4.0,
                air_gap=5e-4,
                force_current=K_i[2 * k : 2 * k + 2],
                force_displacement=K_s[2 * k : 2 * k + 2],
            )
            for k in range(bearings)
        ],
        tolerance=Tolerance(exact=True),
        amplifier=Amplifier(time_constant=5e-5),
        actuator=Actuator(time_constant=tau_e),
        controller=PidController(
            implementation="analog",
            proportional=2.2e4,
            integral=0.0,
            derivative=30.0,
            derivative_time_constant=6e-5,
        ),
    )


def long_bench(bearings: int) -> Bench:
    """The machine with its truth, which lies up to 5 % off the nominal values of its rig."""
    random = np.random.default_rng(bearings)
    K_i, K_s = np.full(2 * bearings, 160.0), np.full(2 * bearings, 1.2e6)
    off = 1.0 + 0.05 * random.uniform(-1.0, 1.0, (2, 2 * bearings))
    return Bench(
        rig=long_rig(bearings, K_i, K_s, 1.5e-4),
        K_i=tuple(K_i * off[0]),
        K_s=tuple(K_s * off[1]),
        tau_e=1.45e-4,
        hold=2,
        periods=6,
        amplitude=0.6,
        middle=0.5 * bearings * PITCH,
        order=9,
    )


LONG = {"four_bearings": long_bench(4), "eight_bearings": long_bench(8)}
