"""ambid: parameters of active magnetic bearings from the machine's own closed loop."""

from importlib.metadata import version

from ambid.compare import Comparison, compare
from ambid.errors import (
    AmbidError,
    IdentificationError,
    InputError,
    ModelError,
    RecordError,
    RigError,
    UnstableLoopError,
)
from ambid.estimate import Estimate, ParameterEstimate
from ambid.excitation import multisine, prbs
from ambid.identify import identify
from ambid.model import Model, Parameter
from ambid.record import Record, StaticLoading, noise_ceiling
from ambid.rig import Controller, Rig
from ambid.static_load import StaticEstimate, static_load

__version__ = version("ambid")

__all__ = [
    "AmbidError",
    "Comparison",
    "Controller",
    "Estimate",
    "IdentificationError",
    "InputError",
    "Model",
    "ModelError",
    "Parameter",
    "ParameterEstimate",
    "Record",
    "RecordError",
    "Rig",
    "RigError",
    "StaticEstimate",
    "StaticLoading",
    "UnstableLoopError",
    "compare",
    "identify",
    "multisine",
    "noise_ceiling",
    "prbs",
    "static_load",
]
