"""Effects between the coil current and the force of the magnets."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.optimize import nnls

from ambid.effects.base import Effect, EffectParameter
from ambid.loop.assembly import combine
from ambid.loop.plant import Plant
from ambid.rig import Rig


class EddyCurrents(Effect):
    """Half-order lag of the flux."""

    name = "eddy_currents"
    physics = "eddy currents make the flux lag the current slower than first order: 1/(1 + sqrt(tau s))"
    signature = "force too small and late over decades of frequency, half as steep as a lag"
    source = "Zhu, Knospe, Maslen, IEEE/ASME Trans. Mechatronics 10 (2005) 59"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """Time constant of the half-order lag [s]."""
        tau = rig.actuator.time_constant
        return [EffectParameter("time_constant", "s", 1e-3 * tau, lower=1e-6 * tau, upper=1.0)]

    def attach(self, plant: Plant) -> None:
        """The flux current behind a sum of lags whose time constants all scale with tau."""
        ratios, shares = half_order()
        for axis in plant.axes:
            current = plant.raw(f"i_f.{axis}")
            states = []
            for k, ratio in enumerate(ratios):
                name = f"eddy.{axis}.{k}"
                state = plant.state(name)
                lagging = plant.port(self.slot("time_constant"), current - state, power=-1, scale=1.0 / ratio)
                plant.set_rate(name, lagging)
                states.append(state)
            plant.inject(f"i_f.{axis}", combine(shares, states) - current)


@cache
def half_order() -> tuple[np.ndarray, np.ndarray]:
    """Time constants, as multiples of tau, and shares of lags that add up to ``1/(1 + sqrt(tau s))``.

    Non-negative least squares over ``tau w = 1e-5 .. 30`` [rad]; the shares add up to one.
    """
    ratios = np.logspace(-2.0, 5.0, 14)
    w = np.logspace(-5.0, 1.5, 200)
    lags = 1.0 / (1.0 + 1j * w[:, None] * ratios)
    target = 1.0 / (1.0 + np.sqrt(1j * w))
    table = np.vstack([lags.real, lags.imag, 1e3 * np.ones((1, len(ratios)))])
    shares, _ = nnls(table, np.concatenate([target.real, target.imag, [1e3]]))
    used = shares > 0.0
    return ratios[used], shares[used]


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
