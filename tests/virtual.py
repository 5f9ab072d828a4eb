"""Virtual experiments written from the physics alone, with NumPy and SciPy: independent of the package's loop and core.

A rigid rotor with one bending mode per plane floats in two magnetic bearings. Its equations are those of the centre
of mass, of the tilt, and of the mode, in the global planes x and y; the package gets the same rotor as mode shapes.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from ambid.record import Record
from ambid.rig import Actuator, Amplifier, Bearing, ModalRotor, PidController, Rig, Tolerance

AXES = ("A_zeta", "A_eta", "B_zeta", "B_eta")
NAMES = (*(f"K_i.{axis}" for axis in AXES), *(f"K_s.{axis}" for axis in AXES), "tau_e")


@dataclass(frozen=True)
class VirtualBench:
    """The truth of a two-bearing bench, SI units; four values are those of `AXES`.

    Forces are f = K_i i + K_s s; z counts from the centre of mass; `bending` is the shape a z^2 + b of the mode, whose
    modal mass is the rotor's mass.
    """

    mass: float = 12.0
    inertia: float = 0.45
    bending: tuple[float, float] = (16.0, -0.6)
    bending_hz: float = 520.0
    bending_damping: float = 0.02
    magnets: tuple[float, float] = (-0.25, 0.22)
    sensors: tuple[float, float] = (-0.30, 0.28)
    tilt: float = 30.0
    K_i: tuple[float, ...] = (190.0, 205.0, 240.0, 233.0)
    K_s: tuple[float, ...] = (1.40e6, 1.55e6, 1.75e6, 1.66e6)
    tau_e: float = 2.2e-4
    tau_a: float = 1.0e-4
    proportional: float = 2.0e4
    integral: float = 2.0e6
    derivative: float = 25.0
    derivative_time_constant: float = 1.0e-4
    sample_rate: float = 1.0e4

    @property
    def truth(self) -> dict[str, float]:
        """True values by the package's names."""
        return dict(zip(NAMES, (*self.K_i, *self.K_s, self.tau_e), strict=True))

    def rig(self, off: float = 0.0) -> Rig:
        """What its owner knows: everything but K_i, K_s and tau_e, whose nominal values are off by up to `off`."""
        errors = 1.0 + off * np.array([1.0, -0.6, -0.9, 0.5, -0.5, 0.8, 0.4, -1.0, 1.0])
        nominal = errors * np.array([*self.K_i, *self.K_s, self.tau_e])
        points = sorted((*self.magnets, 0.0, *self.sensors))
        bearings = [
            Bearing(
                name=name,
                position=magnet,
                sensor_position=sensor,
                tilt=self.tilt,
                bias_current=3.0,
                air_gap=4e-4,
                force_current=nominal[k : k + 2],
                force_displacement=nominal[k + 4 : k + 6],
            )
            for name, magnet, sensor, k in zip("AB", self.magnets, self.sensors, (0, 2), strict=True)
        ]
        rotor = ModalRotor(
            frequencies_hz=[0.0, 0.0, self.bending_hz],
            damping=[0.0, 0.0, self.bending_damping],
            positions=points,
            shapes=[
                [1.0 / np.sqrt(self.mass) for _ in points],
                [z / np.sqrt(self.inertia) for z in points],
                [self._bent(z) / np.sqrt(self.mass) for z in points],
            ],
        )
        controller = PidController(
            implementation="analog",
            proportional=self.proportional,
            integral=self.integral,
            derivative=self.derivative,
            derivative_time_constant=self.derivative_time_constant,
        )
        return Rig(
            name="virtual bench",
            sample_rate=self.sample_rate,
            rotor=rotor,
            bearings=bearings,
            amplifier=Amplifier(time_constant=self.tau_a),
            actuator=Actuator(time_constant=nominal[8]),
            controller=controller,
            tolerance=Tolerance(exact=True),
        )

    def respond(self, i_e: np.ndarray, noise: np.ndarray | None = None) -> np.ndarray:
        """Outputs [y, i_c] from rest, shape (N, 8, runs), of an excitation (N, 4) and sensor noise (N, 4, runs)."""
        slope, drive = self.continuous()
        n = len(slope)
        block = np.zeros((n + 8, n + 8))
        block[:n] = np.hstack([slope, drive])
        step = expm(block / self.sample_rate)[:n]
        noise = np.zeros((len(i_e), 4, 1)) if noise is None else noise
        x = np.zeros((n, noise.shape[2]))
        outputs = np.empty((len(i_e), 8, noise.shape[2]))
        sensor, amplifier = self.sensing(), slice(12, 16)
        for k, (u, v) in enumerate(zip(i_e, noise, strict=True)):
            outputs[k, :4] = sensor @ x[:6] + v
            outputs[k, 4:] = x[amplifier]
            x = step[:, :n] @ x + step[:, n : n + 4] @ u[:, None] + step[:, n + 4 :] @ v
        return outputs

    def records(
        self,
        i_e: np.ndarray,
        seeds: Iterable[int],
        *,
        period: int | None = None,
        sensor_noise: float = 50e-9,
        current_noise: float = 5e-3,
    ) -> list[Record]:
        """One record per seed; white sensor noise [m] goes round the loop, white noise [A] lies on i_c."""
        random = [np.random.default_rng(seed) for seed in seeds]
        noise = sensor_noise * np.stack([r.standard_normal(i_e.shape) for r in random], axis=2)
        outputs = self.respond(i_e, noise)
        outputs[:, 4:] += current_noise * np.stack([r.standard_normal(i_e.shape) for r in random], axis=2)
        return [
            Record(f"run {k}", self.sample_rate, AXES, i_e, run[:, :4], run[:, 4:], period=period)
            for k, run in enumerate(np.moveaxis(outputs, 2, 0))
        ]

    def _bent(self, z: float) -> float:
        return self.bending[0] * z**2 + self.bending[1]

    def _directions(self) -> np.ndarray:
        """Unit vectors of zeta and eta in x and y, shape (2, 2)."""
        angle = np.deg2rad(self.tilt)
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    def _reading(self, places: tuple[float, float]) -> np.ndarray:
        """Displacements of all axes at two places from (x, y), tilts and mode of both planes, shape (4, 6)."""
        at = [np.array([1.0, z, self._bent(z)]) for z in places]
        return np.vstack([np.kron(row, self._directions()) for row in at])

    def sensing(self) -> np.ndarray:
        """Readings of all axes from the coordinates, shape (4, 6)."""
        return self._reading(self.sensors)

    def continuous(self) -> tuple[np.ndarray, np.ndarray]:
        """Slope of the states and what i_e and sensor noise add to it.

        States: 6 coordinates, 6 rates, currents i_a, currents i_f behind the eddy lag, integrals, filtered y.
        """
        q, rate, i_a, i_f, integral, lagged = np.split(np.arange(28), [6, 12, 16, 20, 24])
        magnet, sensor = self._reading(self.magnets), self.sensing()
        inertia = np.repeat([self.mass, self.inertia, self.mass], 2)
        omega = 2.0 * np.pi * self.bending_hz
        slope, drive = np.zeros((28, 28)), np.zeros((28, 8))
        slope[q, rate] = 1.0
        slope[np.ix_(rate, q)] = magnet.T @ (np.array(self.K_s)[:, None] * magnet) / inertia[:, None]
        slope[np.ix_(rate, i_f)] = magnet.T * self.K_i / inertia[:, None]
        slope[rate[4:], q[4:]] -= omega**2
        slope[rate[4:], rate[4:]] -= 2.0 * self.bending_damping * omega
        slope[i_f, i_a], slope[i_f, i_f] = 1.0 / self.tau_e, -1.0 / self.tau_e
        slope[np.ix_(integral, q)], drive[integral, np.arange(4, 8)] = sensor, 1.0
        slope[np.ix_(lagged, q)] = sensor / self.derivative_time_constant
        slope[lagged, lagged] = -1.0 / self.derivative_time_constant
        drive[lagged, np.arange(4, 8)] = 1.0 / self.derivative_time_constant
        # i_a' = (i_ref - i_a) / tau_a with i_ref = -(P y + I integral + D (y - lagged) / T) + i_e
        direct = self.proportional + self.derivative / self.derivative_time_constant
        slope[np.ix_(i_a, q)] = -direct * sensor / self.tau_a
        slope[i_a, integral] = -self.integral / self.tau_a
        slope[i_a, lagged] = self.derivative / self.derivative_time_constant / self.tau_a
        slope[i_a, i_a] = -1.0 / self.tau_a
        drive[i_a, np.arange(4)], drive[i_a, np.arange(4, 8)] = 1.0 / self.tau_a, -direct / self.tau_a
        return slope, drive
