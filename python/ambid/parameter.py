"""An uncertain number of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Parameter"]


@dataclass(frozen=True)
class Parameter:
    """An uncertain number of the model.

    Attributes
    ----------
    name : str
        Such as ``K_i.A_zeta``, ``K_s.A_zeta``, ``tau_e``.
    value : float
        Present value, in `unit`.
    unit : str
    slots : tuple of str
        Places in Delta that it fills; several where axes share it.
    lower, upper : float
        What physics allows, in `unit`.
    typical : float or None
        Size by which the optimiser scales; None where that is its value.
    """

    name: str
    value: float
    unit: str
    slots: tuple[str, ...]
    lower: float = 0.0
    upper: float = np.inf
    typical: float | None = None

    @property
    def scale(self) -> float:
        """A positive number of the parameter's own size."""
        return self.value if self.typical is None else max(abs(self.value), self.typical)
