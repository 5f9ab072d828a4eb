"""ambid: parameters of active magnetic bearings from the machine's own closed loop."""

from importlib.metadata import version

from ambid.bias_point import Campaign
from ambid.campaign import campaign
from ambid.check import Soundness, check
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
from ambid.interop import (
    controller_from,
    controller_from_mat,
    rotor_from_ross,
    to_control,
    to_mat,
    to_scipy,
)
from ambid.localise import Localisation, localise
from ambid.model import Model, Parameter
from ambid.noise.ceiling import noise_ceiling
from ambid.rank import Ranking, rank
from ambid.record import ChannelMap, Record, StaticLoading
from ambid.rig import Controller, Rig, StateSpaceController, TransferFunctionController
from ambid.static_load import StaticEstimate, static_load
from ambid.whitened import Noise

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
