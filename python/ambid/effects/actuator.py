"""Effects between the coil current and the force of the magnets."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.optimize import nnls

from ambid.loop.assembly import combine
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant
from ambid.rig import Rig


class EddyCurrents(Effect):
    """Half-order lag of the flux."""

    name = "eddy_currents"
    physics = "eddy currents make the flux lag the current slower than first order: 1/(1 + sqrt(tau s))"
    signature = "force too small and late over decades of frequency, half as steep as a lag"
    source = "Zhu, Knospe, Maslen, IEEE/ASME Trans. Mechatronics 10 (2005) 59"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Root of the time constant tau of the half-order lag [s^0.5]; the effect is in proportion to it."""
        return [EffectParameter("root_time_constant", "s^0.5", 1e-4, upper=0.1)]

    def attach(self, plant: Plant) -> None:
        """``flux = i - sqrt(tau) sqrt(s) flux``, with sqrt(s) as a sum of ``c s/(s + p)`` whatever tau is."""
        poles, weights = half_derivative()
        for k, axis in enumerate(plant.axes):
            # poles of different axes must not coincide: the loop would have no well-conditioned modes
            apart = 1.0 + 0.03 * k
            flux = plant[f"i_f.{axis}"]
            parts = []
            for j, pole in enumerate(poles):
                name = f"eddy.{axis}.{j}"
                state = plant.state(name)
                plant.set_rate(name, pole * apart * (flux - state))
                parts.append(flux - state)
            lost = combine(weights * np.sqrt(apart), parts)
            plant.inject(f"i_f.{axis}", -plant.port(self.slot("root_time_constant"), lost))


@cache
def half_derivative() -> tuple[np.ndarray, np.ndarray]:
    """Poles p [1/s] and weights c of ``sqrt(s) ~ sum c s/(s + p)``.

    Non-negative least squares of the relative error over 3 .. 1e5 rad/s.
    """
    poles = np.geomspace(0.3, 2e6, 16)
    w = np.geomspace(3.0, 1e5, 300)
    target = np.sqrt(1j * w)
    parts = 1j * w[:, None] / (1j * w[:, None] + poles) / target[:, None]
    weights, _ = nnls(np.vstack([parts.real, parts.imag]), np.concatenate([np.ones(len(w)), np.zeros(len(w))]))
    return poles, weights


class AxisCrossCoupling(Effect):
    """Current along one axis makes force along the other axis of the same bearing."""

    name = "axis_cross_coupling"
    physics = "current along eta also makes force along zeta of the same bearing, and back"
    signature = "zeta answers eta and eta answers zeta with the same sign, at one bearing"
    source = "Schweitzer, Maslen (eds.), Magnetic Bearings, 2009, chapter 3"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Part of the force that appears on the other axis, of each bearing."""
        both = [b for b in rig.bearings if len(b.axes) == 2]
        return [EffectParameter(f"share_{b.name}", "1", 0.005, lower=-0.5, upper=0.5) for b in both]

    def attach(self, plant: Plant) -> None:
        """``i_zeta += c i_eta``, ``i_eta += c i_zeta`` of the current that makes force."""
        for bearing in plant.rig.bearings:
            if len(bearing.axes) < 2:
                continue
            zeta, eta = bearing.axis_names
            slot = self.slot(f"share_{bearing.name}")
            for to, source in ((zeta, eta), (eta, zeta)):
                plant.inject(f"i_f.{to}", plant.port(slot, plant.raw(f"i_f.{source}")))
