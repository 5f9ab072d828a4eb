"""ambid: parameters of active magnetic bearings from the machine's own closed loop."""

from importlib.metadata import version

from ambid.compare import Comparison, compare
from ambid.diagnose import diagnose
from ambid.diagnosis import Diagnosis
from ambid.effects import CATALOGUE, Effect, EffectParameter
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
from ambid.rank import Ranking, rank
from ambid.record import Record, StaticLoading, noise_ceiling
from ambid.rig import Controller, Rig
from ambid.static_load import StaticEstimate, static_load

__version__ = version("ambid")

__all__ = [
    "CATALOGUE",
    "AmbidError",
    "Comparison",
    "Controller",
    "Diagnosis",
    "Effect",
    "EffectParameter",
    "Estimate",
    "IdentificationError",
    "InputError",
    "Model",
    "ModelError",
    "Parameter",
    "ParameterEstimate",
    "Ranking",
    "Record",
    "RecordError",
    "Rig",
    "RigError",
    "StaticEstimate",
    "StaticLoading",
    "UnstableLoopError",
    "compare",
    "diagnose",
    "identify",
    "multisine",
    "noise_ceiling",
    "prbs",
    "rank",
    "static_load",
]
