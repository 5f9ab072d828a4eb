"""A levitator of one axis whose controller follows a reference, written from its physics, apart from the core.

Held commands u reach the coil by ``tau i' = u/R - i``; the mass obeys ``m s'' = K_i i + K_s s``, or the law of two
magnets that pull against each other, or of one that pulls against the weight.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ambid import Rig

Law = Callable[[float, float], float]


@dataclass(frozen=True)
class Levitator:
    """`gain` is 1/R of a voltage-driven coil, else 1; with `gap` and `bias` the force is of two magnets, or one."""

    mass: float
    K_i: float
    K_s: float
    tau: float
    gain: float = 1.0
    gap: float | None = None
    bias: float = 0.0
    back_emf: float = 0.0
    single: bool = False

    def rig(self, rate: float, controller: dict, off: float = 0.0) -> Rig:
        """Rig file of it, whose nominal K_i and K_s are off by a part of them."""
        bearing = {
            "name": "A",
            "axes": ["zeta"],
            "position": 0.0,
            "sensor_position": 0.0,
            "bias_current": self.bias or 0.9,
            "air_gap": self.gap or 0.01,
            "force_current": (1.0 + off) * self.K_i,
            "force_displacement": (1.0 - off) * self.K_s,
        }
        return Rig(
            name="levitator",
            sample_rate=rate,
            rotor={"kind": "mass", "mass": self.mass},
            bearing=[bearing],
            amplifier={"time_constant": self.tau},
            actuator={"has_lag": False},
            controller=controller,
            tolerance={"exact": True},
        )

    def force(self, i: float, s: float) -> float:
        """With ``K_s = K_i bias/gap`` at rest if it is not linear."""
        if self.gap is None:
            return self.K_i * i + self.K_s * s
        i, s = i / self.bias, s / self.gap
        if self.single:
            return 0.5 * self.K_i * self.bias * (((1.0 + i) / (1.0 - s)) ** 2 - 1.0)
        return 0.25 * self.K_i * self.bias * (((1.0 + i) / (1.0 - s)) ** 2 - ((1.0 - i) / (1.0 + s)) ** 2)

    def run(
        self,
        rate: float,
        law: Law,
        r: np.ndarray,
        i_e: np.ndarray,
        *,
        noise: tuple[float, float] = (0.0, 0.0),
        seed: int = 0,
        limit: float = np.inf,
    ) -> dict[str, np.ndarray]:
        """Signals y, i_c and i_ref, of a digital law u[k] = -law(y[k] - r[k], i_c[k]) + i_e[k], read with noise."""
        random = np.random.default_rng(seed)
        rates = np.zeros((4, 4))
        rates[0, 1] = 1.0
        rates[1, [0, 2]] = np.array([self.K_s, self.K_i]) / self.mass
        rates[2, 1:] = np.array([-self.back_emf, -1.0, self.gain]) / self.tau
        step = expm(rates / rate)
        x, found = np.zeros(3), []
        for k in range(len(r)):
            y = x[0] + noise[0] * random.standard_normal()
            i_c = x[2] + noise[1] * random.standard_normal()
            u = float(np.clip(-law(y - r[k], i_c) + i_e[k], -limit, limit))
            found.append((y, i_c, u))
            x = step[:3, :3] @ x + step[:3, 3] * u if self.gap is None else self._further(x, u, 1.0 / rate)
        return dict(zip(("y", "i_c", "i_ref"), np.array(found).T[:, :, None], strict=True))

    def _further(self, x: np.ndarray, u: float, duration: float) -> np.ndarray:
        def slope(_: float, x: np.ndarray) -> list[float]:
            drive = self.gain * u - self.back_emf * x[1] - x[2]
            return [x[1], self.force(x[2], x[0]) / self.mass, drive / self.tau]

        return solve_ivp(slope, (0.0, duration), x, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]


def pid(proportional: float, integral: float, derivative: float, rate: float, of_current: float = 0.0) -> Law:
    """P e + I times the trapezoidal sum of e + D times the difference of e, plus a share of the current."""
    before = total = 0.0

    def law(e: float, i: float) -> float:
        nonlocal before, total
        total += 0.5 * (e + before) / rate
        u = proportional * e + integral * total + derivative * rate * (e - before) + of_current * i
        before = e
        return u

    return law


def pid_matrices(
    proportional: float, integral: float, derivative: float, rate: float, of_current: float = 0.0
) -> dict[str, list[list[float]]]:
    """A, B, C, D of the same law, states: the error before, and the sum up to it."""
    return {
        "A": [[0.0, 0.0], [0.5 / rate, 1.0]],
        "B": [[1.0, 0.0], [0.5 / rate, 0.0]],
        "C": [[0.5 * integral / rate - derivative * rate, integral]],
        "D": [[proportional + 0.5 * integral / rate + derivative * rate, of_current]],
    }
