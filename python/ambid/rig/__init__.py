"""What is known of a machine before any record is read: the rig file and its tables."""

from ambid.rig.controller import Controller, PidController, StateSpaceController, TransferFunctionController
from ambid.rig.magnets import Actuator, Amplifier, Bearing
from ambid.rig.parts import Disk, Material, Section, Sensor, Support
from ambid.rig.rig import Rig, as_rig
from ambid.rig.rotor import FiniteElementRotor, MatrixRotor, ModalRotor, PointMassRotor, Rotor
from ambid.rig.tolerance import Tolerance

__all__ = [
    "Actuator",
    "Amplifier",
    "Bearing",
    "Controller",
    "Disk",
    "FiniteElementRotor",
    "Material",
    "MatrixRotor",
    "ModalRotor",
    "PidController",
    "PointMassRotor",
    "Rig",
    "Rotor",
    "Section",
    "Sensor",
    "StateSpaceController",
    "Support",
    "Tolerance",
    "TransferFunctionController",
    "as_rig",
]
