"""The model that users hold: a rig, what fills its Delta, and the values of the parameters."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambid.errors import ModelError
from ambid.loop.loop import Loop, Simulator
from ambid.record import Record
from ambid.rig import Rig

__all__ = ["Model", "Parameter"]

FORMAT = "ambid model 1"
UNITS = {"K_i": "N/A", "K_s": "N/m", "tau_e": "s"}


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
    """

    name: str
    value: float
    unit: str
    slots: tuple[str, ...]


class Model:
    """A closed-loop model: rig and parameters. Immutable; every change returns a new model.

    Parameters
    ----------
    rig : Rig
    parameters : sequence of Parameter, optional
        Default: K_i and K_s of every axis at the rig's nominal values and one tau_e shared by all axes.

    Raises
    ------
    ModelError
        If the parameters do not fill every slot of Delta just once, or a value is not positive.
    """

    def __init__(self, rig: Rig, parameters: Sequence[Parameter] | None = None) -> None:
        self.rig = rig
        self.parameters = tuple(_nominal(rig) if parameters is None else parameters)
        filled = [slot for parameter in self.parameters for slot in parameter.slots]
        needed = [slot for parameter in _nominal(rig) for slot in parameter.slots]
        if sorted(filled) != sorted(needed):
            raise ModelError(
                f"parameters fill {', '.join(sorted(filled))}; expected each of {', '.join(sorted(needed))} just once"
            )
        for parameter in self.parameters:
            if not (np.isfinite(parameter.value) and parameter.value > 0.0):
                raise ModelError(
                    f"{parameter.name} = {parameter.value}: expected a positive number in {parameter.unit}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def theta(self) -> NDArray[np.float64]:
        """Values of all parameters, in the order of `names`, SI units."""
        return np.array([parameter.value for parameter in self.parameters])

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

    def share(self, name: str, members: Iterable[str]) -> Model:
        """Return the model with one parameter in place of several, starting from their mean.

        Parameters
        ----------
        name : str
            Name of the shared parameter, such as ``K_i.A``.
        members : iterable of str
            Names or patterns of the parameters that it replaces, such as ``K_i.A_*``.
        """
        chosen = [self.parameters[i] for i in self.index(members)]
        if len({parameter.unit for parameter in chosen}) != 1:
            raise ModelError(f"{', '.join(p.name for p in chosen)} cannot be shared: their units differ")
        slots = tuple(slot for parameter in chosen for slot in parameter.slots)
        shared = Parameter(name, float(np.mean([p.value for p in chosen])), chosen[0].unit, slots)
        at = self.parameters.index(chosen[0])
        rest = [p for p in self.parameters if p not in chosen]
        return self._with_parameters([*rest[:at], shared, *rest[at:]])

    def per_axis(self, name: str) -> Model:
        """Return the model with a shared parameter split into one per axis, all starting from its value."""
        (at,) = self.index([name])
        shared = self.parameters[at]
        own = [Parameter(slot, shared.value, shared.unit, (slot,)) for slot in shared.slots]
        return self._with_parameters([*self.parameters[:at], *own, *self.parameters[at + 1 :]])

    def index(self, patterns: Iterable[str]) -> list[int]:
        """Indices of the parameters that names or patterns such as ``K_i.*`` select, in the model's order.

        Raises
        ------
        ModelError
            If one of them selects nothing.
        """
        found: set[int] = set()
        for pattern in patterns:
            own = {i for i, name in enumerate(self.names) if fnmatchcase(name, pattern)}
            own |= {i for i, name in enumerate(self.names) if name.startswith(f"{pattern}.")}
            if not own:
                raise ModelError(f"{pattern}: no such parameter; the model has {', '.join(self.names)}")
            found |= own
        return sorted(found)

    @cached_property
    def loop(self) -> Loop:
        """The closed loop, inputs i_e, outputs y and i_c."""
        return Loop(self.rig, self._filled_by())

    def simulate(self, i_e: ArrayLike) -> Record:
        """Response from rest to an excitation, without noise.

        Parameters
        ----------
        i_e : array_like, shape (N, axes)
            [A], held from sample to sample.

        Returns
        -------
        Record
            With y [m] and i_c [A].

        Raises
        ------
        UnstableLoopError
            If the closed loop is unstable.
        """
        excitation = np.asarray(i_e, dtype=np.float64)
        return self._record("simulated", excitation, self.loop.simulate(self.theta, excitation))

    def virtual_experiment(
        self, i_e: ArrayLike, *, sensor_noise: float = 50e-9, current_noise: float = 1e-2, seed: int | None = None
    ) -> Record:
        """Simulate what an instrument would record: noise on the displacements goes round the loop.

        Parameters
        ----------
        i_e : array_like, shape (N, axes)
            [A].
        sensor_noise : float
            Rms of white noise on every displacement [m]; the controller reads it too.
        current_noise : float
            Rms of white noise on every recorded current [A].
        seed : int, optional
        """
        excitation = np.asarray(i_e, dtype=np.float64)
        random = np.random.default_rng(seed)
        noise = sensor_noise * random.standard_normal(excitation.shape)
        loop = Loop(self.rig, self._filled_by(), noise=True)
        outputs = loop.simulate(self.theta, np.hstack([excitation, noise]))
        n = len(self.rig.axes)
        outputs[:, n:] += current_noise * random.standard_normal(excitation.shape)
        return self._record("virtual experiment", excitation, outputs)

    def simulator(self) -> Simulator:
        """Return the embedded simulator of the loop: one sample at a time."""
        return self.loop.simulator(self.theta)

    def poles(self) -> NDArray[np.complex128]:
        """Poles of the closed loop [1/s], slowest first; a digital loop's are ln(mu) fs of its poles mu."""
        return self.loop.poles(self.theta)

    @property
    def is_stable(self) -> bool:
        """Whether every pole decays."""
        return bool(self.poles().real.max() < 0.0)

    def save(self, path: str | Path, covariance: ArrayLike | None = None) -> None:
        """Write the model as JSON: rig, effects, parameters, and their covariance where there is one.

        Parameters
        ----------
        path : str or Path
        covariance : array_like, shape (parameters, parameters), optional
            NaN for parameters that were not free.
        """
        matrix = None
        if covariance is not None:
            matrix = [[None if np.isnan(c) else float(c) for c in row] for row in np.asarray(covariance)]
        parameters = {p.name: {"value": p.value, "unit": p.unit, "slots": list(p.slots)} for p in self.parameters}
        text: dict[str, Any] = {
            "format": FORMAT,
            "rig": self.rig.to_toml(),
            "effects": [],
            "parameters": parameters,
            "covariance": matrix,
        }
        Path(path).write_text(json.dumps(text, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path, rig: Rig | None = None) -> Model:
        """Read a model that `save` wrote.

        Parameters
        ----------
        path : str or Path
        rig : Rig, optional
            Take this rig in place of the stored one, such as the same machine at another bias current.

        Raises
        ------
        ModelError
            If the file is none of ours or has been broken.
        """
        try:
            text: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
            if text.get("format") != FORMAT:
                raise ModelError(f"{path}: format = {text.get('format')!r}, expected {FORMAT!r}, as --save writes it")
            parameters = [
                Parameter(name, float(p["value"]), p["unit"], tuple(p["slots"]))
                for name, p in text["parameters"].items()
            ]
            return cls(rig or Rig.from_toml(text["rig"], path), parameters)
        except OSError as error:
            raise ModelError(f"{path}: cannot be read ({error.strerror}); give a file that --save wrote") from None
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ModelError(f"{path}: not a model that --save wrote ({type(error).__name__}: {error})") from None

    def __repr__(self) -> str:
        rows = [f"  {p.name:12s} {p.value:12.6g} {p.unit}" for p in self.parameters]
        return "\n".join([f"Model of {self.rig.name!r}, {len(self.rig.axes)} axes", *rows])

    def _with_parameters(self, parameters: Sequence[Parameter]) -> Model:
        model = Model(self.rig, parameters)
        if "loop" in self.__dict__ and [p.slots for p in model.parameters] == [p.slots for p in self.parameters]:
            model.__dict__["loop"] = self.loop  # the compiled loop does not hold values
        return model

    def _filled_by(self) -> dict[str, int]:
        return {slot: i for i, parameter in enumerate(self.parameters) for slot in parameter.slots}

    def _record(self, name: str, excitation: NDArray[np.float64], outputs: NDArray[np.float64]) -> Record:
        axes = self.rig.axes
        n = len(axes)
        return Record(name, self.rig.sample_rate, axes, excitation, outputs[:, :n], outputs[:, n:])


def _nominal(rig: Rig) -> list[Parameter]:
    """K_i and K_s of every axis as the rig gives them, and one tau_e."""
    of_axes = {
        "K_i": [value for bearing in rig.bearings for value in bearing.force_current],
        "K_s": [value for bearing in rig.bearings for value in bearing.force_displacement],
    }
    parameters = [
        Parameter(f"{kind}.{axis}", value, UNITS[kind], (f"{kind}.{axis}",))
        for kind, values in of_axes.items()
        for axis, value in zip(rig.axes, values, strict=True)
    ]
    slots = tuple(f"tau_e.{axis}" for axis in rig.axes)
    return [*parameters, Parameter("tau_e", rig.actuator.time_constant, UNITS["tau_e"], slots)]
