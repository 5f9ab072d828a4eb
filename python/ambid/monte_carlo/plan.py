"""What a Monte Carlo does: the truth with its spreads, the experiment, and what is made of each record."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any, Literal, cast, get_args

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects import Effect
from ambid.errors import InputError
from ambid.model import Model, Parameter
from ambid.record import Record
from ambid.record.repeats import find_period
from ambid.rig import Rig
from ambid.rig.toml import toml_text

AMPLITUDE = "amplitude"
"""Key of the amplitude of the excitation, whose value is 1: it multiplies what is given."""
EXPECTED = "KEY=normal:SIZE, KEY=uniform:SIZE or KEY=uniform:LOW:HIGH, a size in SI units or such as 5%"
Kind = Literal["normal", "uniform"]


@dataclass(frozen=True)
class Spread:
    """A distribution of one value, or of each value that a pattern selects.

    Attributes
    ----------
    key : str
        ``amplitude``; a parameter of the true model or a pattern, such as ``K_i.A_*`` or ``loop_delay.delay``; or a
        number of the rig file, such as ``bearing.A.air_gap`` or ``amplifier.time_constant``.
    kind : str
        ``normal`` or ``uniform``.
    size : float
        Standard deviation, or half width, about the value; nothing where there is a `span`.
    relative : bool
        Whether the size is a part of the value.
    span : tuple of float, optional
        Limits of ``uniform`` in place of a size.
    """

    key: str
    kind: Kind
    size: float = 0.0
    relative: bool = True
    span: tuple[float, float] | None = None

    @classmethod
    def parse(cls, text: str) -> Spread:
        """Read ``KEY=DIST``, such as ``K_i=normal:5%``, ``tau_e=uniform:1e-5`` or ``amplitude=uniform:0.5:2``.

        Raises
        ------
        InputError
            If it reads otherwise.
        """
        key, _, rest = text.partition("=")
        kind, *sizes = rest.split(":")
        allowed = {("normal", 1), ("uniform", 1), ("uniform", 2)}
        if not key or (kind, len(sizes)) not in allowed or kind not in get_args(Kind):
            raise InputError(f"spread {text}: expected {EXPECTED}")
        relative = len(sizes) == 1 and sizes[0].endswith("%")
        try:
            numbers = [float(size.removesuffix("%") if relative else size) for size in sizes]
        except ValueError:
            raise InputError(f"spread {text}: {':'.join(sizes)} is no number; expected {EXPECTED}") from None
        if not np.isfinite(numbers).all() or (len(numbers) == 1 and numbers[0] < 0.0) or sorted(numbers) != numbers:
            raise InputError(f"spread {text}: expected a finite size of 0 or more, or LOW below HIGH")
        if len(numbers) == 2:
            return cls(key, "uniform", span=(numbers[0], numbers[1]))
        return cls(key, cast(Kind, kind), numbers[0] / (100.0 if relative else 1.0), relative)

    def draw(self, value: float, random: np.random.Generator) -> float:
        """One number, about `value`."""
        if self.span is not None:
            return float(random.uniform(*self.span))
        size = self.size * abs(value) if self.relative else self.size
        return value + size * float(random.standard_normal() if self.kind == "normal" else random.uniform(-1.0, 1.0))


@dataclass(frozen=True)
class Truth:
    """What one run is simulated with.

    Attributes
    ----------
    model : Model
    amplitude : float
        Factor on the excitation.
    drawn : dict of str to float
        By key, with an index where a key of the rig holds several numbers.
    seed : int
        Of the noise, as `Model.virtual_experiment` takes it.
    """

    model: Model
    amplitude: float
    drawn: dict[str, float]
    seed: int


@dataclass(frozen=True, eq=False)
class Plan:
    """Many virtual experiments on a machine, whose owner knows its rig.

    A value of the rig file that is known to a tolerance is off by an error of its own in every run.

    Attributes
    ----------
    rig : Rig
        From which every run is identified.
    excitation : ndarray, shape (N, axes)
        i_e [A].
    truth : Model, optional
        What is simulated: values, and effects that are hidden; by default the rig's nominal values.
    spreads : tuple of Spread
    sensor_noise, current_noise : float
        As for `Model.virtual_experiment` [m], [A].
    further_noise : mapping of str to float
        Of further signals or channels that are recorded, as for `Model.virtual_experiment`.
    seed : int
        The one number that all randomness comes from.
    diagnose : bool
        Whether each record is diagnosed; else it is identified.

    Raises
    ------
    InputError
        If an effect, value or key of a spread does not fit the rig.
    """

    rig: Rig
    excitation: FloatArray
    truth: Model | None = None
    spreads: tuple[Spread, ...] = ()
    sensor_noise: float = 50e-9
    current_noise: float = 1e-2
    seed: int = 0
    diagnose: bool = False
    further_noise: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"seed = {self.seed}: expected a whole number of 0 or more")
        if self.excitation.ndim != 2 or self.excitation.shape[1] != len(self.rig.axes):
            raise InputError(
                f"excitation of shape {self.excitation.shape}: expected (N, {len(self.rig.axes)}), a column an axis"
            )
        _ = self.drawn  # refuses a key that is nowhere

    def __reduce__(self) -> tuple[Any, ...]:
        """A model holds compiled loops, which stay where they are."""
        own = {key.name: getattr(self, key.name) for key in fields(self)} | {"truth": None}
        return _again, (own, self.machine.rig, self.machine.parameters, self.machine.effects)

    @cached_property
    def machine(self) -> Model:
        """What is simulated, without spreads."""
        return self._recorded(Model(self.rig) if self.truth is None else self.truth)

    def _recorded(self, model: Model) -> Model:
        """With the further channels that are recorded."""
        return model.with_outputs(tuple(self.further_noise)) if self.further_noise else model

    @cached_property
    def start(self) -> Model:
        """What every run is identified from."""
        return Model(self.rig)

    @cached_property
    def period(self) -> int | None:
        """Of the excitation, in samples."""
        return find_period(self.excitation)

    def content(self) -> dict[str, Any]:
        """All that decides what a run is, as plain data; numbers may differ from version to version."""
        return {
            "version": version("ambid"),
            "rig": self.rig.to_toml(),
            "excitation": hashlib.sha256(np.ascontiguousarray(self.excitation).tobytes()).hexdigest(),
            "machine": self.machine.rig.to_toml(),
            "effects": [{"name": effect.name, **effect.settings()} for effect in self.machine.effects],
            "values": {p.name: p.value for p in self.machine.parameters},
            "spreads": [repr(spread) for spread in self.spreads],
            "sensor_noise": self.sensor_noise,
            "current_noise": self.current_noise,
            "seed": self.seed,
            "diagnose": self.diagnose,
            **({"further_noise": dict(self.further_noise)} if self.further_noise else {}),
        }

    @cached_property
    def key(self) -> str:
        """Another one for every other content."""
        return hashlib.sha256(json.dumps(self.content(), sort_keys=True).encode()).hexdigest()

    @cached_property
    def drawn(self) -> tuple[str, ...]:
        """What is drawn for each run, beside the parameters that are identified."""
        names = list[str]()
        for spread in self.spreads:
            at = _at_key(self._data, spread.key)
            if spread.key == AMPLITUDE or isinstance(at, float):
                names.append(spread.key)
            elif at is not None:
                names += [f"{spread.key}.{k}" for k in range(len(at))]
            else:
                names += [self.machine.names[i] for i in self.machine.index([spread.key])]
        names += [p.name for p in self.machine.with_tolerances().tolerances]
        return tuple(dict.fromkeys(name for name in names if name not in self.start.names))

    @property
    def _data(self) -> dict[str, Any]:
        return self.machine.rig.model_dump(by_alias=True, exclude_none=True)

    def of_run(self, run: int) -> Truth:
        """What a run is simulated with; the same whatever other runs there are."""
        sequence = np.random.SeedSequence(self.seed, spawn_key=(run,))  # the run-th of SeedSequence(seed).spawn(...)
        random = np.random.default_rng(sequence)
        seed = int(sequence.generate_state(1, np.uint64)[0] >> 1)  # fits a signed integer
        amplitude, drawn = 1.0, dict[str, float]()
        data = self._data
        later = []
        for spread in self.spreads:
            if spread.key == AMPLITUDE:
                amplitude = drawn[AMPLITUDE] = spread.draw(1.0, random)
            elif (at := _at_key(data, spread.key)) is None:
                later.append(spread)
            elif isinstance(at, float):
                drawn[spread.key] = spread.draw(at, random)
                _set_key(data, spread.key, drawn[spread.key])
            else:
                several = tuple(spread.draw(value, random) for value in at)
                drawn |= {f"{spread.key}.{k}": value for k, value in enumerate(several)}
                _set_key(data, spread.key, several)
        model = self.machine
        if drawn.keys() - {AMPLITUDE}:
            model = _on(Rig.from_toml(toml_text(data)), model)
        for spread in later:
            own = [model.names[i] for i in model.index([spread.key])]
            at_run = {p.name: spread.draw(p.value, random) for p in model.parameters if p.name in own}
            drawn |= at_run
            model = model.with_values(at_run)
        model = self._recorded(model).with_tolerances()
        errors = self._errors(model, run)
        model = model.with_values(errors)
        return Truth(model, amplitude, drawn | errors, seed)

    def _errors(self, model: Model, run: int) -> dict[str, float]:
        """What the rig file is off by in a run: values that are known to a tolerance have an error of their own."""
        random = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(run, 1)))
        errors = {p.name: float(p.prior or 0.0) * float(random.standard_normal()) for p in model.tolerances}
        return {p.name: min(max(errors[p.name], p.lower), p.upper) for p in model.tolerances}

    def record(self, run: int, truth: Truth) -> Record:
        """What the instruments of a run record."""
        made = truth.model.virtual_experiment(
            truth.amplitude * self.excitation,
            sensor_noise=self.sensor_noise,
            current_noise=self.current_noise,
            further_noise=self.further_noise,
            seed=truth.seed,
        )
        return replace(made, name=f"run {run}", period=self.period)


def _on(rig: Rig, model: Model) -> Model:
    """A model on a rig with other numbers; values that the rig states are its own."""
    before = {p.name: p.value for p in Model(model.rig).parameters}
    now = {p.name: p.value for p in Model(rig).parameters}
    moved = Model(rig, model.parameters, model.effects)
    return moved.with_values({name: value for name, value in now.items() if value != before.get(name)})


def _again(own: dict[str, Any], rig: Rig, parameters: Sequence[Parameter], effects: Sequence[Effect]) -> Plan:
    return Plan(**own | {"truth": Model(rig, parameters, effects)})


def _at_key(data: dict[str, Any], key: str) -> tuple[float, ...] | float | None:
    """The number, or numbers, of a rig's data at a key such as ``bearing.A.air_gap``; None where there is none."""
    found: Any = data
    for name in key.split("."):
        found = _member(found, name)
    if isinstance(found, int | float) and not isinstance(found, bool):
        return float(found)
    if isinstance(found, Sequence) and found and all(isinstance(own, int | float) for own in found):
        return tuple(map(float, found))
    return None


def _set_key(data: dict[str, Any], key: str, value: tuple[float, ...] | float) -> None:
    """Put a number in the place of that which `_at_key` found."""
    *way, last = key.split(".")
    found: Any = data
    for name in way:
        found = _member(found, name)
    found[last] = value


def _member(table: Any, name: str) -> Any:
    """An entry of a table, or of a list of tables the one with that name."""
    if isinstance(table, dict):
        return table.get(name)
    if isinstance(table, list | tuple):
        return next((own for own in table if isinstance(own, dict) and own.get("name") == name), None)
    return None
