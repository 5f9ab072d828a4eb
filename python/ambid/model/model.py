"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.channels import first_outputs, further
from ambid.effects import CATALOGUE, Effect, find
from ambid.effects.instruments import with_instruments
from ambid.errors import ModelError
from ambid.loop.loop import Loop, Simulator
from ambid.model.contents import Contents
from ambid.model.experiment import inputs_of, simulated, virtual_experiment
from ambid.model.file import read_model, write_model
from ambid.model.operating_point import further_points, nominal_of_points, outputs_of, parameters_at, selected_outputs
from ambid.model.parameter import Parameter, of_effect, shared, split, to_rig
from ambid.model.structure import Structure, is_nonlinear, require_allowed
from ambid.record import Measurement, Record
from ambid.results import html_table, of_unit
from ambid.rig import Rig


class Model(Contents):
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

    def exact(self) -> Model:
        """Return the model on its rig taken for exact, without the parameters that are known to a tolerance."""
        return Model(self.rig.exact(), [self.parameters[i] for i in self.free], self.effects)

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

        A further bias current or air gap brings a K_i and K_s of its own for every axis, such as ``K_i.A_zeta@8A``. Of
        a model with tolerances, a channel beyond y and i_c brings gain and instant of its instrument.

        Raises
        ------
        ModelError
            If a record is of another machine.
        """
        records = tuple(records)
        points = further_points(self.rig, self.points, records)
        known = with_instruments(self.structure.known, (name for own in records for name in own.channels), self.rig)
        if len(points) == len(self.points) and known == self.structure.known:
            return self
        usual = [*nominal_of_points(self.rig, points), *(p for own in known for p in of_effect(self.rig, own, {}))]
        more = [p for p in usual if p.name not in self.names]
        return self._of(replace(self.structure, points=tuple(points), known=known), [*self.parameters, *more])

    def at(self, where: Measurement | Rig) -> Model:
        """The model at an operating point of the machine: its rig, with the K_i and K_s of that bias and gap.

        Names, order and values of the parameters stay; those of others fill nothing. Of a record with more than y and
        i_c the first outputs of the loop are its channels.

        Raises
        ------
        ModelError
            If the point has a bias current or gap that the model does not cover, or is of another machine.
        RecordError
            If the machine has no such channel.
        """
        if isinstance(where, Rig):
            rig, measured = where, self.structure.measured
        else:
            rig, measured = where.point or self.rig, outputs_of(where, self.rig)
        is_here = rig is self.rig or rig == self.rig
        if is_here and measured == self.structure.measured:
            return self
        structure = replace(self.structure, measured=measured)
        if is_here:
            here = self._made_of(structure, tuple(self.parameters))
        else:
            own = parameters_at(rig, self.rig, self.points, self.parameters, self.effects)
            here = self._of(replace(structure, rig=rig, points=()), own)
        if (rig, measured) not in self._loops:
            self._loops[rig, measured] = here.loop
        here._loops[None], here._covariance = self._loops[rig, measured], self._covariance
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
        return self._made_of(replace(self.structure, effects=(*self.effects, effect)), (*self.parameters, *more))

    def without(self, name: str) -> Model:
        """Return the model without one of its effects."""
        effects = [effect for effect in self.effects if effect.name != name]
        if len(effects) == len(self.effects):
            raise ModelError(f"{name} is not in the model; it has {', '.join(e.name for e in self.effects) or 'none'}")
        parameters = [p for p in self.parameters if not p.name.startswith(f"{name}.")]
        return self._of(replace(self.structure, effects=tuple(effects)), parameters)

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

    def with_outputs(self, channels: str | Iterable[str], *, currents: bool = True) -> Model:
        """Return the model whose loop, and whose virtual records, have further channels.

        Parameters
        ----------
        channels : str or iterable of str
            Of `Rig.outputs`, such as ``a.drive_end``, or signals such as ``b``, with all their channels.
        currents : bool
            Whether they come behind y and i_c; else behind y, as of a record without i_c.

        Raises
        ------
        ModelError
            If the machine has no such output.
        """
        usual = (f"{signal}.{axis}" for signal in ("y", "i_c")[: 1 + currents] for axis in self.rig.axes)
        return self.recorded_as((*usual, *selected_outputs(self.rig, channels)))

    def recorded_as(self, channels: Iterable[str]) -> Model:
        """Return the model whose loop has exactly the channels of a record first, by their names, in its order.

        Raises
        ------
        ModelError
            If the machine has no such output.
        """
        names = tuple(channels)
        selected_outputs(self.rig, further(names, self.rig.axes))
        measured = first_outputs(names, self.rig.axes)
        if measured == self.structure.measured:
            return self
        return self._made_of(replace(self.structure, measured=measured), tuple(self.parameters))

    def with_noise_inputs(self) -> Loop:
        """The loop with noise of the sensors as further inputs, and of i_c where the controller reads it."""
        if not self._noisy:
            self._noisy.append(self.structure.compiled(self.parameters, noise=True))
        return self._noisy[0]

    def with_substeps(self, substeps: int | None) -> Model:
        """Return the model with a number of steps per sample of its own for nonlinear effects."""
        if substeps == self.structure.substeps:
            return self
        return self._made_of(replace(self.structure, substeps=substeps), self.parameters)

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
            With y [m], i_c [A] and what `with_outputs` says.

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
        further_noise: Mapping[str, float] | None = None,
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
        further_noise : mapping of str to float, optional
            Rms of white noise by further signal, such as ``b``, or channel, such as ``a.drive_end``, in its unit;
            they are recorded beside those of `with_outputs`, which have none.
        seed : int, optional

        Raises
        ------
        ModelError
            If a noise or the seed is negative, and as for `simulate`.
        UnstableLoopError
            If the closed loop is unstable.
        """
        noise, model = further_noise or {}, self
        if noise:
            model = self.with_outputs((*further(self.structure.measured, self.rig.axes), *noise))
        return virtual_experiment(
            model.structure,
            model.with_noise_inputs(),
            model.theta,
            i_e,
            r,
            sensor_noise=sensor_noise,
            current_noise=current_noise,
            further_noise=noise,
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

    @property
    def decay_rate(self) -> float:
        """Of the slowest pole, at whichever operating point [1/s]; negative where the loop is unstable."""
        return min(-float(self.at(rig).poles().real.max()) for rig in (self.rig, *self.points))

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays; of a nonlinear loop those at rest."""
        return self.decay_rate > 0.0

    @property
    def may_stand(self) -> bool:
        """Whether it is stable at rest, or where its nonlinear effects are left out, as friction that slips."""
        return self.is_stable or (not self.is_linear and self.without_nonlinear().is_stable)

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

    def _repr_html_(self) -> str:
        rows = [[p.name, p.value, p.unit] for p in self.parameters if p.prior is None]
        return html_table(["parameter", "value", "unit"], rows, [repr(self)])

    def __repr__(self) -> str:
        effects = ", ".join(effect.name for effect in self.effects) or "no effects added"
        return f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes, {effects}"

    def __str__(self) -> str:
        rows = [f"  {p.name:12s} {p.value:12.6g}{of_unit(p.unit)}" for p in self.parameters if p.prior is None]
        return "\n".join([repr(self), *rows])
