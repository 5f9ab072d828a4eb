"""The true rotor: the known modes and what is wrong about them, in global x and y."""

import numpy as np
from scipy.interpolate import make_interp_spline

from ambid.rig import ModalRotor, PointMassRotor, Rig
from ambid.rotor import reduced_rotor


class TrueRotor:
    """Modes of the rotor that is in the machine, modes of plane x before those of plane y.

    Attributes
    ----------
    planes : int
    squares, damping : ndarray, shape (m,)
        omega^2, and 2 zeta omega and what the rotor has to ground, of all modes.
    gyroscopic : ndarray, shape (m, m)
        Per rad/s.
    drive_end : float
        z of the end of the shaft [m].
    """

    def __init__(self, rig: Rig, hidden: dict[str, dict], flexible_modes: int | None) -> None:
        places = [z for bearing in rig.bearings for z in (bearing.position, bearing.sensor_position)]
        places += [support.z for support in rig.rotor.support]
        rotor, known = rig.rotor, reduced_rotor(rig.rotor, places)
        extra = hidden.get("rotor_bending_mode", {"count": 0, "participation": 1.0})
        if isinstance(rotor, ModalRotor | PointMassRotor):
            if flexible_modes is not None or extra["count"]:
                raise ValueError(f"a rotor of kind {rotor.kind} has just the modes that it is given with")
            modes = known
        else:
            kept = rotor.flexible_modes if flexible_modes is None else flexible_modes
            modes = reduced_rotor(rotor.model_copy(update={"flexible_modes": kept + extra["count"]}), places)
        frequencies, damping = modes.frequencies_rad_s.copy(), modes.damping.copy()
        same = min(len(frequencies), len(known.frequencies_rad_s))
        frequencies[:same] = known.frequencies_rad_s[:same]  # free of the last digits of another mesh
        scale = np.ones(len(frequencies))
        if extra["count"]:
            scale[-extra["count"] :] = extra["participation"]
        if "rotor_inertia_error" in hidden:
            wrong = hidden["rotor_inertia_error"]
            scale[0] /= np.sqrt(wrong["mass_factor"])
            scale[1:2] /= np.sqrt(wrong["inertia_factor"])
        if "bending_mode_shift" in hidden:
            wrong = hidden["bending_mode_shift"]
            mode = np.flatnonzero(frequencies)[wrong["mode"]]
            frequencies[mode] *= wrong["frequency_factor"]
            damping[mode] = damping[mode] if wrong["damping"] is None else wrong["damping"]
        self.planes = modes.planes
        every = np.tile(frequencies, self.planes)
        if "rotor_anisotropy" in hidden:
            every[len(frequencies) :] *= hidden["rotor_anisotropy"]["frequency_factor"]
        self.squares = every**2
        self.damping = rig.rotor.mass_damping + 2.0 * np.tile(damping, self.planes) * every
        scales = np.tile(scale, self.planes)
        factor = hidden.get("gyroscopic_coupling", {"factor": 1.0})["factor"]
        self.gyroscopic = factor * scales[:, None] * modes.gyroscopic * scales
        self._shapes = modes.shapes * scale
        self._positions = modes.positions
        self.drive_end = float(modes.positions[-1]) if self.planes == 2 else 0.0

    def at(self, z: float) -> np.ndarray:
        """Displacement [u_x, u_y] at any z on the shaft from the modal coordinates, shape (planes, m)."""
        if self.planes == 1:
            return self._shapes
        degree = 3 if len(self._positions) > 3 else 1
        return np.kron(np.eye(2), make_interp_spline(self._positions, self._shapes, degree)(z))

    def weight(self, gravity: float) -> np.ndarray:
        """Modal forces of gravity [m/s^2] along -y (along - of the axis of a point mass), shape (m,)."""
        if self.planes == 1:
            return -gravity / self._shapes[0]
        of_modes = np.linalg.lstsq(self._shapes, np.ones(len(self._shapes)), rcond=None)[0]
        return np.concatenate([np.zeros(len(of_modes)), -gravity * np.where(np.abs(of_modes) > 1e-9, of_modes, 0.0)])
