"""Machines whose rig file is off by ordinary tolerances: every value by a draw of its own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ambid.loop.geometry import rotor_of
from ambid.record import Record
from ambid.rig import Rig

from .bench import simulate

__all__ = ["TABLE", "Machine", "machine_off", "measured_off"]

TABLE = {
    "mass": 0.005,
    "inertia": 0.01,
    "position": 0.0,
    "sensor_position": 5e-4,
    "sensor_angle": 0.0,
    "sensor_gain": 0.01,
    "current_gain": 0.005,
    "excitation_gain": 0.002,
    "instant": 0.0,
    "bending_frequency": 0.002,
    "modal_damping": 0.2,
    "amplifier_time_constant": 0.05,
    "controller_gain": 0.01,
}
"""[tolerance] of the rig files."""


class Machine(NamedTuple):
    """A machine that is off from its rig file.

    Attributes
    ----------
    known : Rig
        The rig file, with its tolerances.
    true : Rig
        With what a rig file can hold of the errors.
    hidden : dict
        The other errors, as `simulate` takes them.
    louder : float
        By which the excitation exceeds what is recorded of it.
    read : ndarray, shape (axes,)
        Factors of the reading of the currents.
    """

    known: Rig
    true: Rig
    hidden: dict
    louder: float
    read: np.ndarray

    def record(self, i_e: np.ndarray, seed: int, beside: Mapping[str, dict] | None = None, **machine: object) -> Record:
        """A record of it, with further effects `beside`; `machine` as of `simulate`."""
        record = simulate(self.true, self.louder * i_e, self.hidden | dict(beside or {}), seed=seed, **machine)
        assert record.i_c is not None
        return replace(record, i_e=i_e, i_c=record.i_c * self.read)


def machine_off(rig: Rig, seed: int) -> Machine:
    """A machine whose every value has an error of its own."""
    draw = np.random.default_rng([seed, 38])

    def off(key: str, size: int | None = None) -> np.ndarray:
        return TABLE[key] * draw.standard_normal(size)

    hidden = {"sensor_gain_error": {"gain": list(1.0 + off("sensor_gain", len(rig.axes)))}}
    if getattr(rig.rotor, "mass", None) is None and rig.rotor.bending_frequencies_hz is None:
        computed = rotor_of(rig).frequencies_rad_s / (2.0 * np.pi)
        measured = {"bending_frequencies_hz": tuple(computed[computed > 0.0].tolist())}
        rig = rig.replace(rotor=rig.rotor.model_copy(update=measured))
    if getattr(rig.rotor, "mass", None) is not None:
        rotor = rig.rotor.model_copy(update={"mass": rig.rotor.mass * (1.0 + off("mass"))})
    else:
        hidden["rotor_inertia_error"] = {"mass_factor": 1.0 + off("mass"), "inertia_factor": 1.0 + off("inertia")}
        hidden["sensor_position_error"] = {"dz": list(off("sensor_position", len(rig.bearings)))}
        hz = np.array(rig.rotor.bending_frequencies_hz)
        rotor = rig.rotor.model_copy(
            update={
                "bending_frequencies_hz": tuple(hz * (1.0 + off("bending_frequency", len(hz)))),
                "modal_damping": rig.rotor.modal_damping * (1.0 + off("modal_damping")),
            }
        )
    own = rig.controller
    gains = {} if own.is_digital else {g: getattr(own, g) * (1.0 + off("controller_gain")) for g in own.gains}
    true = rig.replace(
        rotor=rotor,
        amplifier=rig.amplifier.model_copy(
            update={"time_constant": rig.amplifier.time_constant * (1.0 + off("amplifier_time_constant"))}
        ),
        controller=own.model_copy(update=gains),
    )
    louder = 1.0 if own.is_digital else 1.0 + off("excitation_gain")
    return Machine(rig.replace(tolerance=TABLE), true, hidden, louder, 1.0 + off("current_gain", len(rig.axes)))


def measured_off(rig: Rig, i_e: np.ndarray, seed: int, **machine: object) -> tuple[Rig, Record]:
    """The rig file, with its tolerances, and a record of a machine that is off from it; `machine` as of `simulate`."""
    own = machine_off(rig, seed)
    return own.known, own.record(i_e, seed, **machine)
