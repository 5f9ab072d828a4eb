"""A rig against itself: the nominal loop is stable, and its magnets, places and sample rate make sense together."""

from __future__ import annotations

import numpy as np

from ambid.checking.nominal import NominalLoop
from ambid.checking.soundness import Finding, LoopFigures
from ambid.rig import Rig

__all__ = ["slips_of_rig"]

GROWING = 1e-6
"""Growth of a controller's pole, relative to its fastest, that is more than rounding of an integrator."""


def slips_of_rig(loop: NominalLoop) -> list[Finding]:
    """What is odd about a rig, before any record."""
    own = loop.rig
    return [
        *_stability(loop),
        *_controller_alone(own),
        *_magnets(own),
        *_planes(loop),
        *_nodes(loop),
        *_gyroscopic(own),
        *_rate(own, LoopFigures.of(loop)),
    ]


def _stability(loop: NominalLoop) -> list[Finding]:
    """The nominal closed loop is stable, or nearly so."""
    if loop.gain_factor == 1.0:
        return []
    worst = loop.nominal_poles[0]
    at = f"{abs(worst.imag) / (2 * np.pi):.3g} Hz"
    what = f"the nominal closed loop is unstable: a pole at {at} grows with {worst.real:.3g} 1/s; {loop.moved_by_worst}"
    if loop.gain_factor is None:
        return [
            Finding.fault(
                "controller",
                f"{what}, and no common factor on K_i from 0.7 to 1.4 helps",
                "check the controller's sign (i_ref = -(K y) + i_e), gains and delay, and the sizes of K_i and K_s",
            )
        ]
    return [
        Finding(
            "warning",
            "bearing.force_current",
            f"{what}; it is stable with all K_i x {loop.gain_factor:g}, which is taken here",
            "check the nominal K_i and K_s; identification starts from a stable point nearby",
        )
    ]


def _controller_alone(rig: Rig) -> list[Finding]:
    """The controller itself is stable, integrators aside."""
    own, rate = rig.controller, rig.sample_rate
    a, *_ = own.state_space(len(rig.axes), rate)
    poles = np.linalg.eigvals(a) if len(a) else np.zeros(0, dtype=complex)
    if own.is_digital:
        poles = np.log(np.where(poles == 0.0, 1e-300, poles).astype(complex)) * own.rate(rate)
    if not len(poles) or poles.real.max() <= GROWING * max(1.0, float(np.abs(poles).max())):
        return []
    worst = poles[np.argmax(poles.real)]
    what = f"unstable by itself: a pole at {abs(worst.imag) / (2 * np.pi):.3g} Hz grows with {worst.real:.3g} 1/s"
    todo = "check its coefficients and their order; hardly a machine is run with such a one"
    return [Finding("warning", "controller", what, todo)]


def _magnets(rig: Rig) -> list[Finding]:
    """K_s s0 = K_i i0 for a pair of ideal magnets."""
    found = []
    for bearing in rig.bearings:
        for axis, k_i, k_s in zip(bearing.axis_names, bearing.force_current, bearing.force_displacement, strict=True):
            ratio = k_s * bearing.air_gap / (k_i * bearing.bias_current)
            if not 0.5 <= ratio <= 2.0:
                found.append(
                    Finding(
                        "warning",
                        f"bearing.{axis}",
                        f"K_s s0 / (K_i i0) = {ratio:.2g}, 1 for ideal magnets",
                        "check air_gap, bias_current, force_current and force_displacement",
                    )
                )
    return found


def _planes(loop: NominalLoop) -> list[Finding]:
    """A shaft is levitated in both planes, or looked at in one."""
    if loop.rotor.planes == 2 or not loop.rotor.positions.size:
        return []
    without = ", and has no gyroscopic moments" if loop.rig.speed else ""
    what = f"all axes lie in one plane: the model holds the rotor's motion in that plane alone{without}"
    return [Finding("note", "bearing.axes", what, "name both axes of every bearing where both planes are levitated")]


def _gyroscopic(rig: Rig) -> list[Finding]:
    """A rotor that turns has gyroscopic moments, if its description holds them."""
    given = {"matrices": "G", "modes": "gyroscopic"}
    key = given.get(rig.rotor.kind)
    if not rig.speed or key is None or getattr(rig.rotor, key) is not None:
        return []
    what = f"missing, at speed = {rig.speed:g} rad/s: the model has no gyroscopic moments"
    return [Finding("note", f"rotor.{key}", what, f"give {key}, or write speed = 0 if they are to be left out")]


def _nodes(loop: NominalLoop) -> list[Finding]:
    """Bending modes within reach that have a node between a magnet and its sensors."""
    hz, found = loop.rotor.frequencies_rad_s / (2.0 * np.pi), []
    for bearing in loop.rig.bearings:
        sign = loop.rotor.shape(bearing.position) * loop.rotor.shape(bearing.sensor_position)
        for f in hz[(hz > 0.0) & (hz < 0.4 * loop.rig.sample_rate) & (sign < 0.0)]:
            found.append(
                Finding(
                    "note",
                    f"bearing.{bearing.name}.sensor_position",
                    f"the bending mode at {f:.4g} Hz has a node between magnet and sensors, which turns its sign",
                    "check both positions; if they are right, the derivative of the controller drives this mode",
                )
            )
    return found


def _rate(rig: Rig, figures: LoopFigures) -> list[Finding]:
    """The sample rate leaves room for the modes and the loop."""
    found, todo = [], "sample faster"
    if high := [f for f in figures.bending_hz if f > 0.4 * rig.sample_rate]:
        what = f"{rig.sample_rate:g} Hz is little for the bending mode at {high[0]:.4g} Hz, expected 2.5 times that"
        found.append(Finding("warning", "sample_rate", what, f"{todo}, or keep fewer flexible_modes"))
    if rig.sample_rate < 10.0 * figures.bandwidth_hz:
        what = f"{rig.sample_rate:g} Hz is little for a loop with a bandwidth of {figures.bandwidth_hz:.3g} Hz"
        found.append(Finding("warning", "sample_rate", f"{what}, expected 10 times that", todo))
    return found
