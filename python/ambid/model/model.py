"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.arrays import is_same
from ambid.effects import CATALOGUE, Effect, find
from ambid.effects.known import KNOWN
from ambid.errors import ModelError
from ambid.loop.loop import Loop, Simulator
from ambid.model.experiment import inputs_of, simulated, virtual_experiment
from ambid.model.file import read_model, write_model
from ambid.model.operating_point import further_points, nominal_of_points, parameters_at
from ambid.model.parameter import Parameter, Parameters, of_effect, selected, shared, split, to_rig
from ambid.model.structure import Structure, is_nonlinear, require_allowed
from ambid.model.update import RigUpdate, update_of
from ambid.record import Measurement, Record
from ambid.results import html_table, of_unit
from ambid.rig import Rig

__all__ = ["Model"]


class Model:
    """A closed-loop model: rig, effects and parameters. Immutable; every change returns a new model.

    Parameters
    ----------
    rig : Rig
    parameters : sequence of Parameter, optional
        Default: K_i and K_s of every axis at the rig's nominal values, R of voltage-driven coils, one tau_e shared by
        all axes unless the actuator has no lag, and those of the effects.
    effects : sequence of Effect
        Physics beyond the base model.
    substeps : int, optional
        Steps per sample of nonlinear effects; default: as many as the response needs to be exact to 1e-6.
    points : sequence of Rig
        The same machine at other operating points, see `covering`.
    reference : Rig, optional
        Rig that the parameters of effects are stated for; default: `rig`.

    Raises
    ------
    ModelError
        If the parameters do not fill every slot of Delta just once, two have one name, a value is not positive, or a
        point is of another machine.
    """

    def __init__(
        self,
        rig: Rig,
        parameters: Sequence[Parameter] | None = None,
        effects: Sequence[Effect] = (),
        *,
        substeps: int | None = None,
        points: Sequence[Rig] = (),
        reference: Rig | None = None,
    ) -> None:
        if not isinstance(rig, Rig):
            raise ModelError(f"rig: {type(rig).__name__} given; expected a Rig, as `Rig.load(path)` reads it")
        structure = Structure(rig, tuple(effects), tuple(points), rig if reference is None else reference, substeps)
        self._set(structure, tuple(structure.usual_parameters() if parameters is None else parameters))

    def _set(self, structure: Structure, parameters: tuple[Parameter, ...]) -> None:
        structure.require_filled(parameters)
        self._take(structure, parameters)

    def _take(self, structure: Structure, parameters: tuple[Parameter, ...]) -> None:
        self.structure, self.parameters = structure, Parameters(parameters)
        self._covariance: NDArray[np.float64] | None = None
        self._loops: dict[Rig | None, Loop] = {}  # of other operating points, and of this one: None
        self._noisy: list[Loop] = []  # the one with noise inputs, once it is compiled

    @classmethod
    def _of(cls, structure: Structure, parameters: Sequence[Parameter]) -> Model:
        model = cls.__new__(cls)
        model._set(structure, tuple(parameters))
        return model

    @classmethod
    def _made_of(cls, structure: Structure, parameters: tuple[Parameter, ...]) -> Model:
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
    def acting(self) -> list[Effect]:
        """Effects that make sense at this operating point."""
        return self.structure.acting

    @property
    def is_linear(self) -> bool:
        """Whether no effect of the model is nonlinear."""
        return not self.loop.lft.blocks

    def without_nonlinear(self) -> Model:
        """Return the model without its nonlinear effects."""
        model = self
        for effect in self.effects:
            home = self.home_of(effect)
            if home is not None and not self.is_linear and is_nonlinear(home, effect):
                model = model.without(effect.name)
        return model

    def with_tolerances(self) -> Model:
        """Return the model with the values of its rig that are known to a tolerance as parameters, all without error.

        They have the rig file's standard deviations as priors, and are fitted beside the others. The same model where
        it has them already, or its rig is exact.
        """
        known = tuple(effect for effect in KNOWN if not effect.why_not(self.rig))
        if self.structure.known or not known:
            return self
        more = [p for effect in known for p in of_effect(self.rig, effect, {})]
        return Model._made_of(replace(self.structure, known=known), (*self.parameters, *more))

    @property
    def tolerances(self) -> tuple[Parameter, ...]:
        """The parameters that are known to a tolerance; their values are errors of the rig file."""
        return tuple(p for p in self.parameters if p.prior is not None)

    def exact(self) -> Model:
        """Return the model on its rig taken for exact, without the parameters that are known to a tolerance."""
        return Model(self.rig.exact(), [self.parameters[i] for i in self.free], self.effects)

    def without_errors(self) -> Model:
        """Return the model with the values of the rig file, whatever errors of them it had."""
        return self.with_values({p.name: 0.0 for p in self.tolerances})

    def opened(self) -> Model:
        """Return the model whose loop has ports for all errors of known values, to be derived by them."""
        return Model._made_of(replace(self.structure, is_open=True), self.parameters)

    @property
    def free(self) -> list[int]:
        """Indices of the parameters of which nothing is known before any record."""
        return [i for i, p in enumerate(self.parameters) if p.prior is None]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Values of all parameters, in the order of `names`, SI units."""
        return np.array([parameter.value for parameter in self.parameters])

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of the parameters, shape (parameters, parameters); NaN for those that were not free.

        None where no identification gave the values: a change of a value or of the structure drops it.
        """
        return self._covariance

    def with_covariance(self, covariance: ArrayLike) -> Model:
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

    def with_values(self, values: Mapping[str, float]) -> Model:
        """Return the model with other values of some parameters.

        Raises
        ------
        ModelError
            If a name is unknown or a value is not positive.
        """
        self.index(values)
        changed = [replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters]
        return self._with_parameters(changed)

    def with_theta(self, theta: ArrayLike) -> Model:
        """Return the model with other values of all parameters, in the order of `names`."""
        values = np.asarray(theta, dtype=np.float64).tolist()
        changed = tuple(replace(p, value=value) for p, value in zip(self.parameters, values, strict=True))
        require_allowed(changed)
        return self._with_values_of(changed)

    def _with_values_of(self, changed: tuple[Parameter, ...]) -> Model:
        """The same parameters at other values."""
        model = Model._made_of(self.structure, changed)
        if self.structure.erring(changed) == self.structure.erring(self.parameters):
            model._loops, model._noisy = self._loops, self._noisy  # compiled loops do not hold values
        return model

    def excitation(self, record: Record) -> NDArray[np.float64]:
        """Inputs of the loop during a record, shape (N, inputs): i_e, r, then those of disturbances in the model.

        Raises
        ------
        RecordError
            If i_e was neither logged nor rebuilt.
        """
        return inputs_of(self.at(record).structure, record)

    def response(self, record: Record) -> NDArray[np.float64]:
        """Simulated y and i_c of a record's experiment, shape (N, outputs), at its operating point."""
        here = self.at(record)
        return here.loop.simulate(here.theta, here.excitation(record))

    def sensitivity(self, record: Record, free: Sequence[int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The same, and its derivative by the parameters in `free`, shape (N, outputs, free)."""
        here = self.at(record)
        return here.loop.sensitivity(here.theta, here.excitation(record), free)

    def covering(self, records: Iterable[Measurement]) -> Model:
        """Return the model with the operating points of these records.

        A further bias current or air gap brings a K_i and K_s of its own for every axis, such as ``K_i.A_zeta@8A``.

        Raises
        ------
        ModelError
            If a record is of another machine.
        """
        points = further_points(self.rig, self.points, records)
        if len(points) == len(self.points):
            return self
        more = [p for p in nominal_of_points(self.rig, points) if p.name not in self.names]
        return Model._of(replace(self.structure, points=tuple(points)), [*self.parameters, *more])

    def at(self, where: Measurement | Rig) -> Model:
        """The model at an operating point of the machine: its rig, with the K_i and K_s of that bias and gap.

        Names, order and values of the parameters stay; those of others fill nothing.

        Raises
        ------
        ModelError
            If the point has a bias current or gap that the model does not cover, or is of another machine.
        """
        rig = where if isinstance(where, Rig) else where.point
        if rig is None or rig is self.rig or rig == self.rig:
            return self
        own = parameters_at(rig, self.rig, self.points, self.parameters, self.effects)
        here = Model._of(replace(self.structure, rig=rig, points=()), own)
        if rig not in self._loops:
            self._loops[rig] = here.loop
        here._loops[None], here._covariance = self._loops[rig], self._covariance
        return here

    def home_of(self, effect: Effect) -> Rig | None:
        """The first operating point where an effect makes sense; None if it does nowhere."""
        return self.structure.home_of(effect)

    def add(self, effect: Effect | str, values: Mapping[str, float] | None = None) -> Model:
        """Return the model with one more physical effect.

        Parameters
        ----------
        effect : Effect or str
            One of your own, or the name of one of the catalogue, such as ``loop_delay``.
        values : mapping of str to float, optional
            Start values by parameter such as ``delay``; default: typical small ones.

        Raises
        ------
        ModelError
            If the name is unknown, the effect is there already, or makes no sense on this rig.
        """
        effect = find(effect) if isinstance(effect, str) else effect
        if effect.name in (own.name for own in self.effects):
            raise ModelError(f"{effect.name} is in the model already")
        home = self.home_of(effect)
        if home is None:
            raise ModelError(f"{effect.name} makes no sense on this rig: {effect.why_not(self.rig)}")
        more = of_effect(home, effect, values or {})
        require_allowed(more)
        if {parameter.name for parameter in more} & set(self.names):
            raise ModelError(f"{effect.name}: one of its parameters has the name of another; rename that one")
        return Model._made_of(replace(self.structure, effects=(*self.effects, effect)), (*self.parameters, *more))

    def without(self, name: str) -> Model:
        """Return the model without one of its effects."""
        effects = [effect for effect in self.effects if effect.name != name]
        if len(effects) == len(self.effects):
            raise ModelError(f"{name} is not in the model; it has {', '.join(e.name for e in self.effects) or 'none'}")
        parameters = [p for p in self.parameters if not p.name.startswith(f"{name}.")]
        return Model._of(replace(self.structure, effects=tuple(effects)), parameters)

    def share(self, name: str, members: Iterable[str]) -> Model:
        """Return the model with one parameter in place of several, starting from their mean.

        Parameters
        ----------
        name : str
            Name of the shared parameter, such as ``K_i.A``.
        members : iterable of str
            Names or patterns of the parameters that it replaces, such as ``K_i.A_*``.
        """
        return self._with_parameters(shared(self.parameters, name, members))

    def per_axis(self, name: str) -> Model:
        """Return the model with shared parameters split into one per axis, all starting from the shared value.

        Parameters
        ----------
        name : str
            Name or pattern of the shared parameters, such as ``tau_e``.

        Raises
        ------
        ModelError
            If there is no such parameter, or none that several axes share.
        """
        return self._with_parameters(split(self.parameters, name))

    def index(self, patterns: Iterable[str]) -> list[int]:
        """Indices of the parameters that names or patterns such as ``K_i.*`` select, in the model's order.

        Raises
        ------
        ModelError
            If one of them selects nothing.
        """
        return selected(self.parameters, patterns)

    @property
    def loop(self) -> Loop:
        """The closed loop, inputs i_e, and r if it has one, outputs y and i_c."""
        if None not in self._loops:
            self._loops[None] = self.structure.compiled(self.parameters)
        return self._loops[None]

    def watching(self, signals: Sequence[str], inlets: Sequence[Effect] = ()) -> Loop:
        """The loop with further outputs: signals of the plant of each axis, such as ``s`` and ``i_f``.

        `inlets` are effects without parameters that bring further inputs.
        """
        return self.structure.compiled(self.parameters, watch=signals, more=inlets)

    def with_noise_inputs(self) -> Loop:
        """The loop with noise of the sensors as further inputs, and of i_c where the controller reads it."""
        if not self._noisy:
            self._noisy.append(self.structure.compiled(self.parameters, noise=True))
        return self._noisy[0]

    def with_substeps(self, substeps: int | None) -> Model:
        """Return the model with a number of steps per sample of its own for nonlinear effects."""
        if substeps == self.structure.substeps:
            return self
        return Model._made_of(replace(self.structure, substeps=substeps), self.parameters)

    def simulate(self, i_e: ArrayLike | None = None, r: ArrayLike | None = None) -> Record:
        """Response from rest to an excitation, without noise.

        Parameters
        ----------
        i_e : array_like, shape (N, axes), optional
            [A], held from sample to sample; zero if only r is given.
        r : array_like, shape (N, axes), optional
            Reference of a controller that has one [m].

        Returns
        -------
        Record
            With y [m] and i_c [A].

        Raises
        ------
        ModelError
            If neither is given, or r of a controller that has no reference.
        UnstableLoopError
            If the closed loop is unstable.
        """
        return simulated(self.structure, self.loop, self.theta, i_e, r)

    def virtual_experiment(
        self,
        i_e: ArrayLike | None = None,
        r: ArrayLike | None = None,
        *,
        sensor_noise: float = 50e-9,
        current_noise: float = 1e-2,
        seed: int | None = None,
    ) -> Record:
        """Simulate what an instrument would record: noise on the displacements goes round the loop.

        Parameters
        ----------
        i_e, r : array_like, shape (N, axes), optional
            As in `simulate`.
        sensor_noise : float
            Rms of white noise on every displacement [m]; the controller reads it too.
        current_noise : float
            Rms of white noise on every recorded current [A]; a controller that reads currents reads it too.
        seed : int, optional

        Raises
        ------
        ModelError
            If a noise or the seed is negative, and as for `simulate`.
        UnstableLoopError
            If the closed loop is unstable.
        """
        return virtual_experiment(
            self.structure,
            self.with_noise_inputs(),
            self.theta,
            i_e,
            r,
            sensor_noise=sensor_noise,
            current_noise=current_noise,
            seed=seed,
        )

    def simulator(self) -> Simulator:
        """Return the embedded simulator of the loop: one sample at a time."""
        return self.loop.simulator(self.theta)

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the closed loop [1/s], slowest first; a digital loop's are ln(mu) fs of its poles mu, -inf of 0."""
        return self.loop.poles(self.theta)

    def to_rig(self) -> Rig:
        """Return the rig with the model's K_i, K_s, R and tau_e as its nominal values; of R and tau_e their means."""
        return to_rig(self.rig, self.parameters)

    def updated_rig(self) -> RigUpdate:
        """The rig with the errors of its values in their keys: what records say of the rig file.

        Values that are known to a tolerance are updated, and nominal K_i, K_s, R and tau_e stay; see `to_rig`.
        """
        return update_of(self.rig, self.parameters, self._covariance)

    @property
    def decay_rate(self) -> float:
        """Of the slowest pole, at whichever operating point [1/s]; negative where the loop is unstable."""
        return min(-float(self.at(rig).poles().real.max()) for rig in (self.rig, *self.points))

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays."""
        return self.decay_rate > 0.0

    def save(self, path: str | Path, covariance: ArrayLike | None = None) -> None:
        """Write the model as JSON: rig, effects, parameters, and their covariance where there is one.

        Parameters
        ----------
        path : str or Path
        covariance : array_like, shape (parameters, parameters), optional
            NaN for parameters that were not free; default: the model's own.
        """
        write_model(Path(path), self.structure, self.parameters, self._covariance if covariance is None else covariance)

    @classmethod
    def load(cls, path: str | Path, rig: Rig | None = None, *, catalogue: Sequence[Effect] = CATALOGUE) -> Model:
        """Read a model that `save` wrote.

        Parameters
        ----------
        path : str or Path
        rig : Rig, optional
            Take this rig in place of the stored one, such as the same machine at another bias current.
        catalogue : sequence of Effect
            Where its effects are found by name; a model with effects of your own needs them here, such as
            ``(*CATALOGUE, own)``.

        Raises
        ------
        ModelError
            If the file is none of ours or has been broken, or an effect of it is not in the catalogue.
        """
        structure, parameters, covariance = read_model(Path(path), rig, catalogue)
        model = cls._of(structure, parameters)
        return model if covariance is None else model.with_covariance(covariance)

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
        if not isinstance(other, Model):
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

    def _repr_html_(self) -> str:
        rows = [[p.name, p.value, p.unit] for p in self.parameters if p.prior is None]
        effects = ", ".join(effect.name for effect in self.effects) or "no effects added"
        said = f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes, {effects}"
        return html_table(["parameter", "value", "unit"], rows, [said])

    def __repr__(self) -> str:
        rows = [f"  {p.name:12s} {p.value:12.6g}{of_unit(p.unit)}" for p in self.parameters if p.prior is None]
        effects = ", ".join(effect.name for effect in self.effects) or "no effects added"
        return "\n".join([f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes, {effects}", *rows])

    def _with_parameters(self, parameters: Sequence[Parameter]) -> Model:
        model = Model._of(self.structure, parameters)
        are_alike = self.structure.erring(parameters) == self.structure.erring(self.parameters)
        if are_alike and [p.slots for p in model.parameters] == [p.slots for p in self.parameters]:
            model._loops, model._noisy = self._loops, self._noisy  # compiled loops do not hold values
        return model
