"""Levitators that nobody chose: one axis, a slow coil, any rate, driven by i_e or by a reference; and what to hide.

The reference of a digital law adds what the law makes of it to the command, so that the independent simulator, which
knows i_e alone, runs them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ambid import Model
from ambid.errors import UnstableLoopError
from ambid.excitation import prbs
from ambid.record import Record
from ambid.rig import Actuator, Amplifier, Bearing, PidController, PointMassRotor, Rig, Tolerance

from .bench import simulate

__all__ = ["DRIVES", "EFFECTS", "Levitator", "levitator"]

RATES = (250.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0, 20000.0)
"""[Hz]"""
DRIVES = ("r prbs", "r steps", "r noise", "r sweep", "i_e prbs", "i_e noise")
TRIES = 500
OFF = 0.15
"""Of the nominal K_i and K_s from the true ones, at the most."""
QUICK = 0.25
"""Of the rotor's own time in which loop and coil must answer, at the most."""


@dataclass(frozen=True)
class Levitator:
    """A machine, how it is driven, and its noises.

    Attributes
    ----------
    rig : Rig
        What is known.
    K_i, K_s, tau_e : float
        True.
    drive : str
        One of `DRIVES`.
    amplitude : float
        Of r [m] or i_e [A].
    samples, cut : int
        Of a record, and so many that are thrown away before.
    pole : float
        Of the rotor without control [rad/s].
    sensor_noise, current_noise, adc_step : float
    with_i_c, with_i_e : bool
        What was recorded besides; a reference always was.
    """

    rig: Rig
    K_i: float
    K_s: float
    tau_e: float
    drive: str
    amplitude: float
    samples: int
    cut: int
    pole: float
    sensor_noise: float
    current_noise: float
    adc_step: float
    with_i_c: bool
    with_i_e: bool

    def record(self, hidden: Mapping[str, Mapping[str, object]], seed: int) -> Record:
        """A record of it, as a file would be loaded."""
        random = np.random.default_rng([seed, 5])
        wanted = self._signal(random)
        by_reference = self.drive.startswith("r ")
        i_e = self._of_reference(wanted) if by_reference else wanted
        made = simulate(
            self.rig, i_e[:, None], hidden, K_i=self.K_i, K_s=self.K_s, tau_e=self.tau_e, seed=seed,
            sensor_noise=self.sensor_noise, current_noise=self.current_noise, adc_step=self.adc_step,
            with_i_c=self.with_i_c, longest_step=1.5e-5,
        )  # fmt: skip
        kept = slice(self.cut, None)
        return Record.from_arrays(
            y=made.y[kept],
            i_c=None if made.i_c is None else made.i_c[kept],
            r=wanted[kept, None] if by_reference else None,
            i_e=i_e[kept, None] if self.with_i_e and not by_reference else None,
            sample_rate=self.rig.sample_rate,
            axes=self.rig.axes,
            rig=self.rig,
        )

    def _signal(self, random: np.random.Generator) -> np.ndarray:
        kind, count = self.drive.split()[1], self.cut + self.samples
        slow = max(1, round(self.rig.sample_rate / self.pole))  # samples of the rotor's own time
        if kind == "prbs":
            order = 8 if count // (3 * 255) >= 2 else 6
            hold = max(1, min(slow // 2, count // (3 * (2**order - 1))))
            one = prbs(order, amplitude=self.amplitude, hold=hold, axes=1, periods=1, seed=int(random.integers(1e9)))
            return np.resize(one[:, 0], count)
        if kind == "steps":
            levels = self.amplitude * random.uniform(-1.0, 1.0, count // (8 * slow) + 2)
            return np.repeat(levels, 8 * slow)[:count]
        if kind == "noise":
            return np.repeat(self.amplitude * random.standard_normal(count // (slow // 3 + 1) + 1), slow // 3 + 1)[
                :count
            ]
        t = np.arange(count) / self.rig.sample_rate
        low, high = 0.05 * self.pole, min(3.0 * self.pole, self.rig.sample_rate)
        return self.amplitude * np.sin(low * t[-1] / np.log(high / low) * ((high / low) ** (t / t[-1]) - 1.0))

    def _of_reference(self, r: np.ndarray) -> np.ndarray:
        a, b, c, d = self.rig.controller.state_space(1, self.rig.sample_rate)
        x, found = np.zeros(len(a)), np.empty(len(r))
        for k, value in enumerate(r):
            found[k] = (c @ x + d[:, 0] * value)[0]
            x = a @ x + b[:, 0] * value
        return found


def levitator(number: int) -> Levitator:
    """The machine of that number.

    Raises
    ------
    ValueError
        If none of the draws is stable.
    """
    random = np.random.default_rng([number, 43])
    for _ in range(TRIES):
        found = _drawn(random)
        if _is_stable(found):
            return _within_limits(found)
    raise ValueError(f"levitator {number}: no stable machine in {TRIES} draws")


def _drawn(random: np.random.Generator) -> Levitator:
    def between(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.4g}")

    rate = float(random.choice(RATES))
    coil = between(5e-4, 3e-2)
    late = float(random.choice([0.0, 0.0, 0.5, 1.0]))
    quick = QUICK / (coil + (1.0 + late) / rate)
    pole = between(max(4.0, 0.3 * quick), max(4.5, min(quick, 200.0)))
    mass, gap, bias = between(0.01, 5.0), between(1e-3, 1.5e-2), between(0.3, 3.0)
    K_s = mass * pole**2
    K_i = K_s * gap / bias
    omega = pole * between(0.8, 1.6)
    proportional = (mass * omega**2 + K_s) / K_i
    derivative = 2.0 * random.uniform(0.5, 1.0) * omega * mass / K_i
    controller = PidController(
        implementation="digital",
        reference=True,
        proportional=float(f"{proportional:.4g}"),
        integral=float(f"{proportional * omega * between(0.02, 0.15):.4g}"),
        derivative=float(f"{derivative:.4g}"),
        derivative_time_constant=float(f"{max(1.0 / rate, 1.0 / (omega * between(10.0, 25.0))):.4g}"),
        delay_samples=late,
    )
    tau_e = coil * between(0.03, 0.2)
    off = 1.0 + OFF * random.uniform(-1.0, 1.0, 2)
    rig = Rig(
        name="levitator",
        sample_rate=rate,
        rotor=PointMassRotor(mass=mass),
        bearing=[
            Bearing(
                name="A", axes=["zeta"], position=0.0, sensor_position=0.0, bias_current=bias, air_gap=gap,
                force_current=float(f"{K_i * off[0]:.3g}"), force_displacement=float(f"{K_s * off[1]:.3g}"),
            )
        ],
        amplifier=Amplifier(time_constant=coil),
        actuator=Actuator(time_constant=float(f"{tau_e * between(0.6, 1.6):.3g}")),
        controller=controller,
        tolerance=Tolerance(exact=True),
    )  # fmt: skip
    drive = str(random.choice(DRIVES))
    size = between(0.02, 0.1) * gap
    if drive.startswith("i_e"):
        size *= mass * omega**2 / K_i
    samples = int(np.clip(between(300.0, 2000.0) / pole * rate, 2500, 30000))
    adc = float(random.choice([0.0, 1.0])) * gap / float(random.choice([2000.0, 8000.0, 30000.0]))
    return Levitator(
        rig=rig.replace(controller=controller.model_copy(update={"reference": drive.startswith("r ")})),
        K_i=K_i, K_s=K_s, tau_e=tau_e, drive=drive, amplitude=size, samples=samples,
        cut=int(random.integers(0, samples // 4)), pole=pole,
        sensor_noise=between(1e-4, 6e-4) * gap, current_noise=between(5e-4, 3e-3) * bias, adc_step=adc,
        with_i_c=bool(random.random() < 0.75), with_i_e=True,
    )  # fmt: skip


def _within_limits(found: Levitator) -> Levitator:
    """The same, driven so that it keeps away from where the law of its magnets ends."""
    quiet = replace(found, sensor_noise=0.0, current_noise=0.0, adc_step=0.0, with_i_c=True)
    bearing, record = found.rig.bearings[0], quiet.record({}, 0)
    most = max(np.abs(record.y).max() / bearing.air_gap / 0.2, np.abs(record.i_c).max() / bearing.bias_current / 0.5)
    return replace(found, amplitude=found.amplitude / max(1.0, float(most)))


def _is_stable(found: Levitator) -> bool:
    """With nominal and with true values, with a margin."""
    model = Model(found.rig)
    true = {"K_i.A_zeta": found.K_i, "K_s.A_zeta": found.K_s, "tau_e": found.tau_e}
    try:
        return min(model.decay_rate, model.with_values(true).decay_rate) > 0.05 * found.pole
    except UnstableLoopError:
        return False


Sized = Callable[[float, Levitator], dict]

EFFECTS: dict[str, tuple[Sized, float, float]] = {
    "force_nonlinearity": (lambda x, m: {"share": 1.0}, 1.0, 1.0),
    "flux_saturation": (lambda x, m: {"level": x, "curve": "blend"}, 0.2, 0.85),
    "eddy_currents": (lambda x, m: {"tau": x * 1e-3 / m.pole}, 0.1, 30.0),
    "magnetic_hysteresis": (lambda x, m: {"share": x, "width": 0.05 * m.rig.bearings[0].bias_current}, 0.05, 0.6),
    "amplifier_bandwidth": (lambda x, m: {"time_constant": m.rig.amplifier.time_constant * (1.0 + x)}, 0.05, 0.8),
    "loop_delay": (lambda x, m: {"seconds": x * 0.05 / m.pole}, 0.1, 1.0),
    "sensor_lag": (lambda x, m: {"tau": x * 0.05 / m.pole}, 0.1, 1.0),
    "sampling_skew": (lambda x, m: {"seconds": x * 0.9 / m.rig.sample_rate}, 0.3, 1.0),
    "back_emf": (lambda x, m: {"coefficient": x * m.rig.bearings[0].bias_current / m.rig.bearings[0].air_gap
                               * m.rig.amplifier.time_constant}, 0.05, 1.0),
    "periodic_disturbance": (lambda x, m: {"frequency_hz": 50.0 if m.rig.sample_rate > 250.0 else 16.7,
                             "amplitude": 0.02 * x * m.rig.bearings[0].bias_current}, 0.3, 3.0),
    "foundation_resonance": (lambda x, m: {"frequency_hz": 1.5 * m.pole / 6.28, "damping": 0.04,
                             "mass_kg": 3.0 * m.rig.rotor.mass / x}, 0.2, 1.0),
    "cubic_bearing_force": (lambda x, m: {"coefficient": x * m.K_s / (0.3 * m.rig.bearings[0].air_gap) ** 2}, 0.1, 3.0),
    "amplifier_dead_band": (lambda x, m: {"current": 0.02 * x * m.rig.bearings[0].bias_current}, 0.2, 2.0),
    "amplifier_asymmetry": (lambda x, m: {"fraction": 0.1 * x}, 0.2, 2.0),
    "sensor_nonlinearity": (lambda x, m: {"quadratic": 0.2 * x / m.rig.bearings[0].air_gap,
                            "cubic": 0.5 * x / m.rig.bearings[0].air_gap ** 2}, 0.2, 3.0),
}  # fmt: skip
"""Of each effect the parameters by its size, the first size, and the largest."""
