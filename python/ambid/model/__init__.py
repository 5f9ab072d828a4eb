"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from ambid.model.given import Given, as_model
from ambid.model.model import Model
from ambid.model.parameter import Parameter

__all__ = ["Given", "Model", "Parameter", "as_model"]
