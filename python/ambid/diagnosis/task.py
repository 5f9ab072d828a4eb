"""What stays the same during a diagnosis."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ambid.diagnosis.evidence import USUAL
from ambid.diagnosis.ranking import Progress
from ambid.effects import Effect
from ambid.model import Model
from ambid.record import Measurement


@dataclass(frozen=True)
class Task:
    """What stays the same during a diagnosis.

    Attributes
    ----------
    nominal : Model
        Where the diagnosis began.
    validate : tuple of Record or FrequencyResponse
        Records that nothing is fitted to.
    catalogue : tuple of Effect
    progress : callable
    as_given : tuple of Effect
        Effects that a person has chosen with their settings, which stay.
    given_prior : mapping of str to float
        Probability of effects by name, before any record, where a person states it.
    """

    nominal: Model
    validate: tuple[Measurement, ...]
    catalogue: tuple[Effect, ...]
    progress: Progress
    as_given: tuple[Effect, ...] = ()
    given_prior: Mapping[str, float] = field(default_factory=dict)

    def beside_nominal(self, model: Model) -> tuple[Effect, ...]:
        """Effects that were added to the nominal model, in their order."""
        return model.effects[len(self.nominal.effects) :]

    @property
    def prior(self) -> Mapping[str, float]:
        """How many of each effect are expected before any record."""
        usual = USUAL / max(1, len(self.catalogue))
        names = [effect.name for effect in (*self.catalogue, *self.as_given)]
        return dict.fromkeys(names, usual) | {name: p / (1.0 - p) for name, p in self.given_prior.items()}

    def price(self, effect: Effect) -> float:
        """Minus the log of that."""
        return -float(np.log(self.prior[effect.name]))
