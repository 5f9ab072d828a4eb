"""Machines of the experiments, and for each effect a family of parameters with one size: 0 is no effect."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ambid.excitation import prbs
from ambid.rig import Rig
from places import BENCH

HERE = Path(__file__).parent
SPEED = 200.0  # rad/s, of experiments on what only acts at speed
AT_SPEED = ("gyroscopic_coupling", "internal_damping", "unbalance", "sensor_runout")


def voltage_driven(rig: Rig) -> Rig:
    """The same loop with coils of 1 ohm, whose voltage the controller commands."""
    return rig.replace(amplifier=rig.amplifier.model_copy(update={"resistance": 1.0}))


@dataclass(frozen=True)
class Bench:
    """A machine with its true parameters and an excitation of about two seconds.

    Attributes
    ----------
    rig : Rig
    K_i, K_s : tuple of float
        True, per axis [N/A, N/m].
    tau_e : float
        True [s].
    hold, periods, order : int
        Of the PRBS.
    amplitude : float
        Of the excitation [A].
    middle : float
        z of seal and unbalance [m].
    sensor_noise, current_noise : float
        Rms [m, A].
    """

    rig: Rig
    K_i: tuple[float, ...]
    K_s: tuple[float, ...]
    tau_e: float
    hold: int
    periods: int
    amplitude: float
    middle: float
    order: int = 10
    sensor_noise: float = 50e-9
    current_noise: float = 5e-3

    @property
    def noise(self) -> dict:
        """Both noises as `bench.simulate` takes them."""
        return {"sensor_noise": self.sensor_noise, "current_noise": self.current_noise}

    @property
    def truth(self) -> dict:
        """K_i, K_s and tau_e as `bench.simulate` takes them."""
        return {"K_i": np.array(self.K_i), "K_s": np.array(self.K_s), "tau_e": self.tau_e}

    @property
    def period(self) -> int:
        """Samples per period."""
        return (2**self.order - 1) * self.hold

    def known_to(self, effects: tuple[str, ...]) -> Rig:
        """The rig file of an experiment: at speed where the effect needs it, rigid where bending is hidden."""
        rig = self.rig
        if set(effects) & set(AT_SPEED):
            rig = rig.replace(speed=SPEED)
        if "rotor_bending_mode" in effects:
            rig = rig.replace(rotor=rig.rotor.model_copy(update={"flexible_modes": 0}))
        if "inductance_error" in effects:  # of a coil whose voltage is commanded
            rig = voltage_driven(rig)
        return rig

    def excitation(self, amplitude: float, seed: int = 0) -> np.ndarray:
        """PRBS on all axes [A], shape (periods * period, axes)."""
        axes = len(self.rig.axes)
        return prbs(self.order, amplitude=amplitude, hold=self.hold, axes=axes, periods=self.periods, seed=seed)


BENCHES = {
    "bench": Bench(
        rig=Rig.load(BENCH),
        K_i=(205.0, 212.0, 262.0, 268.0),
        K_s=(2.39e6, 2.49e6, 3.13e6, 3.19e6),
        tau_e=2.5e-4,
        hold=5,
        periods=4,
        amplitude=1.0,
        middle=0.43,
    ),
    "small": Bench(
        rig=Rig.load(HERE / "small_rig.toml"),
        K_i=(76.0, 73.0, 58.0, 60.0),
        K_s=(4.5e5, 4.3e5, 3.4e5, 3.6e5),
        tau_e=1.5e-4,
        hold=9,
        periods=4,
        amplitude=0.4,
        middle=0.24,
    ),
    "compressor": Bench(
        rig=Rig.load(HERE / "compressor_rig.toml"),
        K_i=(124.0, 121.0, 126.0, 129.0),
        K_s=(9.5e5, 9.3e5, 9.4e5, 9.7e5),
        tau_e=1.2e-4,
        hold=6,
        periods=8,
        amplitude=0.5,
        middle=0.31,
        order=9,
        sensor_noise=120e-9,
        current_noise=2e-3,
    ),
}


@dataclass(frozen=True)
class Family:
    """Parameters of one effect by its size.

    Attributes
    ----------
    at : callable
        From a size x and a bench to parameters.
    first : float
        Size to start the search from.
    most : float
        Largest size that is physical.
    on_all_lines : bool
        Whether the effect also shows, or only shows, on lines that are not excited.
    by_amplitude : bool
        Whether the size is the amplitude of the excitation [A], the effect itself being what it is.
    """

    at: Callable[[float, Bench], dict]
    first: float
    most: float = np.inf
    on_all_lines: bool = False
    by_amplitude: bool = False


def _second_order(pole: float, bench: Bench) -> dict:
    """The known lag of the amplifier and a second one of `pole` seconds."""
    known = bench.rig.amplifier.time_constant
    omega = 1.0 / np.sqrt(known * pole)
    return {"frequency_hz": float(omega / (2.0 * np.pi)), "damping": float(0.5 * (known + pole) * omega)}


FAMILIES: dict[str, Family] = {
    "rotor_bending_mode": Family(lambda x, b: {"count": b.rig.rotor.flexible_modes, "participation": x}, 0.1, 1.0),
    "bending_mode_shift": Family(lambda x, b: {"frequency_factor": 1.0 + x}, 1e-4, 0.1),
    "rotor_inertia_error": Family(lambda x, b: {"mass_factor": 1.0 + 0.5 * x, "inertia_factor": 1.0 + x}, 1e-3, 0.5),
    "gyroscopic_coupling": Family(lambda x, b: {"factor": 1.0 + x}, 0.1, 3.0),
    "unbalance": Family(lambda x, b: {"mass_eccentricity": x, "z": b.middle, "phase": 0.7}, 1e-5, on_all_lines=True),
    "seal_forces": Family(lambda x, b: {"z": b.middle, "direct": x, "cross": 0.75 * x, "damping": 4e-4 * x}, 1e3, 2e6),
    "coupling_stiffness": Family(lambda x, b: {"stiffness": x, "damping": 1e-4 * x}, 1e3, 2e6),
    "external_damping": Family(lambda x, b: {"rate": x}, 0.1, 200.0),
    "internal_damping": Family(lambda x, b: {"damping": x, "z": b.middle}, 1.0, 2e3),
    "magnetic_pull": Family(lambda x, b: {"stiffness": x, "z": b.middle}, 1e3, 2e6),
    "foundation_resonance": Family(
        lambda x, b: {"frequency_hz": 170.0, "damping": 0.04, "mass_kg": 1.0 / x}, 1e-4, 0.1
    ),
    "force_nonlinearity": Family(lambda x, b: {"share": 1.0}, 0.1, 3.0, by_amplitude=True),
    "flux_saturation": Family(lambda x, b: {"level": 0.75, "curve": "blend"}, 0.1, 3.0, by_amplitude=True),
    "sensor_nonlinearity": Family(lambda x, b: {"quadratic": x, "cubic": 1e4 * x}, 1.0, 5e3),
    "bias_asymmetry": Family(lambda x, b: {"bias": 0.05}, 0.1, 3.0, by_amplitude=True),
    "sensor_runout": Family(
        lambda x, b: {"amplitude": [x * part for part in (1.0, 0.2, 0.7, 0.4)]}, 1e-9, 1e-5, on_all_lines=True
    ),
    "eddy_currents": Family(lambda x, b: {"tau": x}, 1e-8, 1e-4),
    "magnetic_hysteresis": Family(lambda x, b: {"share": x, "width": 0.4 * b.amplitude}, 0.01, 0.5),
    "axis_cross_coupling": Family(lambda x, b: {"fraction": x}, 1e-3, 0.5),
    "amplifier_bandwidth": Family(_second_order, 1e-6, 1e-3),
    "amplifier_voltage_limit": Family(lambda x, b: {"slew": 1.0 / x}, 1e-4, 5e-3),
    "command_saturation": Family(lambda x, b: {"level": b.amplitude / x}, 0.1, 4.0),
    "loop_delay": Family(lambda x, b: {"seconds": x}, 1e-6, 1e-3),
    "sensor_lag": Family(lambda x, b: {"tau": x}, 1e-6, 1e-3),
    "sensor_gain_error": Family(lambda x, b: {"gain": [1.0 + x, 1.0, 1.0, 1.0]}, 1e-3, 0.5),
    "sensor_misalignment": Family(lambda x, b: {"degrees": [x, -0.5 * x]}, 0.1, 20.0),
    "sensor_position_error": Family(lambda x, b: {"dz": [x, 0.0]}, 1e-4, 0.03),
    "sampling_skew": Family(lambda x, b: {"seconds": x}, 1e-6, 0.9e-4),
    "back_emf": Family(lambda x, b: {"coefficient": x}, 0.1, 50.0),
    "inductance_error": Family(lambda x, b: {"error": 0.5 * x, "gap_part": min(x, 1.0)}, 0.01, 10.0),
    "periodic_disturbance": Family(
        lambda x, b: {"frequency_hz": 50.0, "amplitude": x, "port": "current"}, 1e-4, on_all_lines=True
    ),
    "cubic_bearing_force": Family(lambda x, b: {"coefficient": x}, 1e13, 1e17),
    "rotor_contact": Family(lambda x, b: {"stiffness": x, "damping": 10.0, "clearance": 1e-5}, 1e4, 1e9),
    "coulomb_friction": Family(lambda x, b: {"force": x, "z": b.middle}, 1.0, 200.0),
    "amplifier_dead_band": Family(lambda x, b: {"current": x}, 1e-3, 0.3),
    "amplifier_asymmetry": Family(lambda x, b: {"fraction": x}, 1e-3, 0.3),
    "command_quantisation": Family(lambda x, b: {"step": x}, 0.01, 1.0, on_all_lines=True),
    "rotor_anisotropy": Family(lambda x, b: {"frequency_factor": 1.0 + x}, 1e-4, 0.1),
    "force_current_drift": Family(lambda x, b: {"fraction": x}, 1e-3, 0.3, on_all_lines=True),
    "parametric_stiffness": Family(lambda x, b: {"stiffness": x, "frequency_hz": 3.7}, 1e3, 1e6, on_all_lines=True),
    "rate_softening": Family(lambda x, b: {"knee": 1.0 / x}, 1e-6, 1e-3),
}
