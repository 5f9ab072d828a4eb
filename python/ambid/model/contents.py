"""What a model holds: a rig, what fills its Delta, the values of the parameters, and the errors of the rig file."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import is_same
from ambid.effects import Effect
from ambid.effects.instruments import with_instruments
from ambid.effects.known import KNOWN
from ambid.errors import ModelError
from ambid.loop.loop import Loop
from ambid.model.parameter import Parameter, Parameters, of_effect, selected
from ambid.model.structure import Structure, require_allowed
from ambid.model.update import RigUpdate, update_of
from ambid.rig import Rig


class Contents:
    """A rig, effects and parameters, with the loops that were compiled of them; immutable.

    Attributes
    ----------
    structure : Structure
    parameters : Parameters
    """

    def _set(self, structure: Structure, parameters: tuple[Parameter, ...]) -> None:
        structure.require_filled(parameters)
        self._take(structure, parameters)

    def _take(self, structure: Structure, parameters: tuple[Parameter, ...]) -> None:
        self.structure, self.parameters = structure, Parameters(parameters)
        self._covariance: NDArray[np.float64] | None = None
        # of other operating points and channels, and of this one: None
        self._loops: dict[tuple[Rig, tuple[str, ...]] | None, Loop] = {}
        self._noisy: list[Loop] = []  # the one with noise inputs, once it is compiled

    @classmethod
    def _of(cls, structure: Structure, parameters: Sequence[Parameter]) -> Self:
        model = cls.__new__(cls)
        model._set(structure, tuple(parameters))
        return model

    @classmethod
    def _made_of(cls, structure: Structure, parameters: tuple[Parameter, ...]) -> Self:
        """Of parameters that are known to fill every slot."""
        model = cls.__new__(cls)
        model._take(structure, parameters)
        return model

    @property
    def rig(self) -> Rig:
        """What is known of the machine."""
        return self.structure.rig

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Physics beyond the base model, in the order of adding."""
        return self.structure.effects

    @property
    def points(self) -> tuple[Rig, ...]:
        """The same machine at other operating points."""
        return self.structure.points

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Values of all parameters, in the order of `names`, SI units."""
        return np.array([parameter.value for parameter in self.parameters])

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Return the model with other values of some parameters.

        Raises
        ------
        ModelError
            If a name is unknown or a value is not positive.
        """
        self.index(values)
        changed = [replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters]
        return self._with_parameters(changed)

    def with_theta(self, theta: ArrayLike) -> Self:
        """Return the model with other values of all parameters, in the order of `names`."""
        values = np.asarray(theta, dtype=np.float64).tolist()
        changed = tuple(replace(p, value=value) for p, value in zip(self.parameters, values, strict=True))
        require_allowed(changed)
        return self._with_values_of(changed)

    def _with_values_of(self, changed: tuple[Parameter, ...]) -> Self:
        """The same parameters at other values."""
        model = self._made_of(self.structure, changed)
        if self.structure.erring(changed) == self.structure.erring(self.parameters):
            model._loops, model._noisy = self._loops, self._noisy  # compiled loops do not hold values
        return model

    def _with_parameters(self, parameters: Sequence[Parameter]) -> Self:
        model = self._of(self.structure, parameters)
        are_alike = self.structure.erring(parameters) == self.structure.erring(self.parameters)
        if are_alike and [p.slots for p in model.parameters] == [p.slots for p in self.parameters]:
            model._loops, model._noisy = self._loops, self._noisy  # compiled loops do not hold values
        return model

    def index(self, patterns: Iterable[str]) -> list[int]:
        """Indices of the parameters that names or patterns such as ``K_i.*`` select, in the model's order.

        Raises
        ------
        ModelError
            If one of them selects nothing.
        """
        return selected(self.parameters, patterns)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of the parameters, shape (parameters, parameters); NaN for those that were not free.

        None where no identification gave the values: a change of a value or of the structure drops it.
        """
        return self._covariance

    def with_covariance(self, covariance: ArrayLike) -> Self:
        """Return the model with the covariance of its parameters, NaN for those that were not free.

        Raises
        ------
        ModelError
            If its shape is another.
        """
        matrix = np.array(covariance, dtype=np.float64)
        if matrix.shape != (len(self.names),) * 2:
            raise ModelError(f"covariance has the shape {matrix.shape}: expected a row a parameter, {len(self.names)}")
        model = self.with_theta(self.theta)
        model._covariance = matrix
        return model

    @property
    def free(self) -> list[int]:
        """Indices of the parameters of which nothing is known before any record."""
        return [i for i, p in enumerate(self.parameters) if p.prior is None]

    @property
    def tolerances(self) -> tuple[Parameter, ...]:
        """The parameters that are known to a tolerance; their values are errors of the rig file."""
        return tuple(p for p in self.parameters if p.prior is not None)

    def with_tolerances(self) -> Self:
        """Return the model with the values of its rig that are known to a tolerance as parameters, all without error.

        They have the rig file's standard deviations as priors, and are fitted beside the others. The same model where
        it has them already, or its rig is exact.
        """
        known: tuple[Effect, ...] = tuple(effect for effect in KNOWN if not effect.why_not(self.rig))
        if self.structure.known or not known:
            return self
        known = with_instruments(known, self.structure.measured, self.rig)
        more = [p for effect in known for p in of_effect(self.rig, effect, {})]
        return self._made_of(replace(self.structure, known=known), (*self.parameters, *more))

    def without_errors(self) -> Self:
        """Return the model with the values of the rig file, whatever errors of them it had."""
        return self.with_values({p.name: 0.0 for p in self.tolerances})

    def opened(self) -> Self:
        """Return the model whose loop has ports for all errors of known values, to be derived by them."""
        if self.structure.is_open or not self.tolerances:
            return self
        return self._made_of(replace(self.structure, is_open=True), self.parameters)

    def updated_rig(self) -> RigUpdate:
        """The rig with the errors of its values in their keys: what records say of the rig file.

        Values that are known to a tolerance are updated, and what effects of the model say of it is corrected, such as
        gains of the controller. Nominal K_i, K_s, R and tau_e stay; see `to_rig`.
        """
        return update_of(self.rig, self.parameters, self._covariance, self.effects)

    def __getitem__(self, name: str) -> Parameter:
        """A parameter, such as ``model["tau_e"]``.

        Raises
        ------
        ModelError
            If there is none of this name.
        """
        found: Parameter = self.parameters[str(name)]
        return found

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    __iter__ = None  # by its names alone

    def __eq__(self, other: object) -> bool:
        """Whether rig, effects, parameters and their covariance are the same."""
        if not isinstance(other, Contents):
            return NotImplemented
        same = self.structure == other.structure and self.parameters == other.parameters
        return same and is_same(self._covariance, other._covariance)

    def __hash__(self) -> int:
        return hash((self.structure, self.parameters))

    def __getstate__(self) -> dict[str, Any]:
        """All but the compiled loops."""
        return {"structure": self.structure, "parameters": self.parameters, "covariance": self._covariance}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._take(state["structure"], state["parameters"])
        self._covariance = state["covariance"]
