"""ambid: parameters of active magnetic bearings from the machine's own closed loop."""

from importlib.metadata import version

from ambid.campaigns import Campaign, campaign
from ambid.checking import Soundness, check
from ambid.diagnosis import Comparison, Diagnosis, Localisation, Ranking, compare, diagnose, localise, rank
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
from ambid.excitation import multisine, prbs
from ambid.identification import Estimate, ParameterEstimate, StaticEstimate, identify, static_load
from ambid.interop import (
    controller_from,
    controller_from_mat,
    rotor_from_ross,
    to_control,
    to_mat,
    to_scipy,
)
from ambid.model import Model, Parameter
from ambid.noise import Noise, noise_ceiling
from ambid.record import ChannelMap, Record, StaticLoading
from ambid.rig import Controller, Rig, StateSpaceController, TransferFunctionController

__version__ = version("ambid")

__all__ = [
    "CATALOGUE",
    "AmbidError",
    "Campaign",
    "ChannelMap",
    "Comparison",
    "Controller",
    "Diagnosis",
    "Effect",
    "EffectParameter",
    "Estimate",
    "IdentificationError",
    "InputError",
    "Localisation",
    "Model",
    "ModelError",
    "Noise",
    "Parameter",
    "ParameterEstimate",
    "Ranking",
    "Record",
    "RecordError",
    "Rig",
    "RigError",
    "Soundness",
    "StaticEstimate",
    "StateSpaceController",
    "StaticLoading",
    "TransferFunctionController",
    "UnstableLoopError",
    "campaign",
    "check",
    "compare",
    "controller_from",
    "controller_from_mat",
    "diagnose",
    "identify",
    "localise",
    "multisine",
    "noise_ceiling",
    "prbs",
    "rank",
    "rotor_from_ross",
    "static_load",
    "to_control",
    "to_mat",
    "to_scipy",
]
