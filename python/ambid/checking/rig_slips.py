"""A rig against itself: the nominal loop is stable, and its magnets, places and sample rate make sense together."""

from typing import Any

import numpy as np

from ambid.checking.nominal import GAIN_FACTORS, NominalLoop
from ambid.checking.soundness import LoopFigures
from ambid.findings import Finding, Kind, Where
from ambid.rig import Rig
from ambid.rig.notes import notes_of

GROWING = 1e-6
"""Growth of a controller's pole, relative to its fastest, that is more than rounding of an integrator."""

_UNSTABLE = (
    "the nominal closed loop is unstable: a pole at {frequency_hz:.3g} Hz grows with {growth_per_s:.3g} 1/s and moves "
    "mostly the rotor's {mode} mode[ {bending_mode}][, {bending_frequency_hz:.4g} Hz at rest]"
)
UNSTABLE_LOOP = Kind(
    "unstable_nominal_loop",
    "error",
    f"{_UNSTABLE}; no common factor on K_i from {{lowest_factor:g}} to {{highest_factor:g}} makes it stable",
    "check the controller's sign (i_ref = -(K y) + i_e), gains and delay, and the sizes of K_i and K_s",
)
STABLE_WITH_FACTOR = Kind(
    "stable_with_other_force_current",
    "warning",
    f"{_UNSTABLE}; it is stable with all K_i x {{gain_factor:g}}, which is taken here",
    "check the nominal K_i and K_s; identification starts from a stable point nearby",
)
UNSTABLE_CONTROLLER = Kind(
    "unstable_controller",
    "warning",
    "the controller is unstable by itself: a pole at {frequency_hz:.3g} Hz grows with {growth_per_s:.3g} 1/s",
    "check its coefficients and their order; such a controller is hardly ever used on a machine",
)
MAGNETS_INCONSISTENT = Kind(
    "magnets_inconsistent",
    "warning",
    "K_s s0 / (K_i i0) = {ratio:.2g}, expected 1 for ideal magnets",
    "check air_gap, bias_current, force_current and force_displacement",
)
ONE_PLANE = Kind(
    "one_plane",
    "note",
    "all axes lie in one plane: the model has the rotor's motion in that plane alone[, and no gyroscopic moments at "
    "speed = {speed_rad_s:g} rad/s]",
    "name both axes of every bearing where both planes are levitated",
)
GYROSCOPIC_MISSING = Kind(
    "gyroscopic_matrix_missing",
    "note",
    "{key} is missing at speed = {speed_rad_s:g} rad/s: the model has no gyroscopic moments",
    "give {key}, or write speed = 0 if they are to be neglected",
)
NODE_BETWEEN = Kind(
    "node_between_magnet_and_sensor",
    "note",
    "the bending mode at {frequency_hz:.4g} Hz has a node between magnet and sensors, which turns its sign",
    "check both positions; if they are right, the derivative of the controller drives this mode",
)
RATE_FOR_MODE = Kind(
    "sample_rate_low_for_mode",
    "warning",
    "{sample_rate_hz:g} Hz is low for the bending mode at {frequency_hz:.4g} Hz, expected 2.5 times that",
    "sample faster, or keep fewer flexible_modes",
)
RATE_FOR_LOOP = Kind(
    "sample_rate_low_for_loop",
    "warning",
    "{sample_rate_hz:g} Hz is low for a loop with a bandwidth of {bandwidth_hz:.3g} Hz, expected 10 times that",
    "sample faster",
)


def slips_of_rig(loop: NominalLoop, figures: LoopFigures) -> list[Finding]:
    """What is odd about a rig, before any record, by its loop and the figures of that."""
    own = loop.rig
    return [
        *_stability(loop),
        *_controller_alone(own),
        *notes_of(own),
        *_magnets(own),
        *_planes(loop),
        *_nodes(loop),
        *_gyroscopic(own),
        *_rate(own, figures),
    ]


def _stability(loop: NominalLoop) -> list[Finding]:
    """The nominal closed loop is stable, or nearly so."""
    if loop.gain_factor == 1.0:
        return []
    worst, (bending, at_rest_hz) = loop.nominal_poles[0], loop.worst_mode
    values: dict[str, Any] = {
        "frequency_hz": float(abs(worst.imag)) / (2 * np.pi),
        "growth_per_s": float(worst.real),
        "mode": "bending" if bending else "rigid-body",
        "bending_mode": bending or None,
        "bending_frequency_hz": at_rest_hz if bending else None,
    }
    if loop.gain_factor is None:
        ends: dict[str, Any] = {"lowest_factor": min(GAIN_FACTORS), "highest_factor": max(GAIN_FACTORS)}
        return [UNSTABLE_LOOP(Where(key="controller"), **values, **ends)]
    return [STABLE_WITH_FACTOR(Where(key="bearing.force_current"), **values, gain_factor=loop.gain_factor)]


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
    values: dict[str, Any] = {"frequency_hz": float(abs(worst.imag)) / (2 * np.pi), "growth_per_s": float(worst.real)}
    return [UNSTABLE_CONTROLLER(Where(key="controller"), **values)]


def _magnets(rig: Rig) -> list[Finding]:
    """K_s s0 = K_i i0 for a pair of ideal magnets that attract."""
    found = []
    for bearing in rig.bearings:
        for axis, k_i, k_s in zip(bearing.axis_names, bearing.force_current, bearing.force_displacement, strict=True):
            ratio = k_s * bearing.air_gap / (k_i * bearing.bias_current)
            if k_s > 0.0 and not 0.5 <= ratio <= 2.0:
                found.append(MAGNETS_INCONSISTENT(Where(key=f"bearing.{bearing.name}", axis=axis), ratio=ratio))
    return found


def _planes(loop: NominalLoop) -> list[Finding]:
    """A shaft is levitated in both planes, or looked at in one."""
    if loop.rotor.planes == 2 or not loop.rotor.positions.size:
        return []
    return [ONE_PLANE(Where(key="bearing.axes"), speed_rad_s=loop.rig.speed or None)]


def _gyroscopic(rig: Rig) -> list[Finding]:
    """A rotor that turns has gyroscopic moments, if its description holds them."""
    given = {"matrices": "G", "modes": "gyroscopic"}
    key = given.get(rig.rotor.kind)
    if not rig.speed or key is None or getattr(rig.rotor, key) is not None:
        return []
    return [GYROSCOPIC_MISSING(Where(key=f"rotor.{key}"), key=key, speed_rad_s=rig.speed)]


def _nodes(loop: NominalLoop) -> list[Finding]:
    """Bending modes within reach that have a node between a magnet and its sensors."""
    hz, found = loop.rotor.frequencies_rad_s / (2.0 * np.pi), []
    for bearing in loop.rig.bearings:
        sign = loop.rotor.shape(bearing.position) * loop.rotor.shape(bearing.sensor_position)
        for f in hz[(hz > 0.0) & (hz < 0.4 * loop.rig.sample_rate) & (sign < 0.0)]:
            found.append(NODE_BETWEEN(Where(key=f"bearing.{bearing.name}.sensor_position"), frequency_hz=float(f)))
    return found


def _rate(rig: Rig, figures: LoopFigures) -> list[Finding]:
    """The sample rate leaves room for the modes and the loop."""
    found, where, rate = [], Where(key="sample_rate"), rig.sample_rate
    if high := [f for f in figures.bending_hz if f > 0.4 * rate]:
        found.append(RATE_FOR_MODE(where, sample_rate_hz=rate, frequency_hz=high[0]))
    if rate < 10.0 * figures.bandwidth_hz:
        found.append(RATE_FOR_LOOP(where, sample_rate_hz=rate, bandwidth_hz=figures.bandwidth_hz))
    return found
