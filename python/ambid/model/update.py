"""What records say of a rig file: the same rig, whose values that are known to a tolerance are those of a model."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.effects.instruments import instruments_among
from ambid.effects.known import KNOWN
from ambid.findings import Finding, Kind, Where
from ambid.loop.effect import Effect
from ambid.model.parameter import Parameter
from ambid.results import readable
from ambid.rig import Rig
from ambid.rig.tolerance import TYPICAL
from ambid.writing import whole_file

NO_KEY = Kind("rig_key_missing", "note", "no key of the rig file holds the error of {name}: {errors}; {why}")


@dataclass(frozen=True)
class UpdatedValue:
    """The error of one value of the rig file.

    Attributes
    ----------
    name : str
        Such as ``sensor_position.A``.
    unit : str
        ``1`` for a relative error.
    prior : float or None
        Standard deviation before the records; None of what an effect of the model corrects, of which nothing was known.
    error : float
        That the records and the tolerance together give.
    std : float or None
        Its standard deviation; None where the model has no covariance.
    left : float
        Part of it that no key of the rig file holds.
    why : str
        Why not; empty where a key holds all of it.
    """

    name: str
    unit: str
    prior: float | None
    error: float
    std: float | None
    left: float
    why: str

    def line(self) -> str:
        """In words, such as ``sensor_position.A +0.31 mm, standard deviation 0.08 mm (tolerance 0.5 mm)``."""
        std, prior = (
            "unknown" if value is None else readable(value, self.unit).removeprefix("+")
            for value in (self.std, self.prior)
        )
        known = "named as wrong" if self.prior is None else f"tolerance {prior}"
        return f"{self.name} {readable(self.error, self.unit)}, standard deviation {std} ({known})"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "error": self.error,
            "std": self.std,
            "tolerance": self.prior,
            "unit": self.unit,
            "not_in_rig": self.left,
            "why": self.why,
        }


@dataclass(frozen=True)
class RigUpdate:
    """A rig whose values known to a tolerance are updated, and what its keys do not hold.

    Attributes
    ----------
    rig : Rig
        A model of it without errors responds as the model that it was made of, but for what is left.
    values : tuple of UpdatedValue
    """

    rig: Rig
    values: tuple[UpdatedValue, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What no key holds, one for every key of [tolerance]."""
        left: dict[tuple[str, str], list[str]] = {}
        for own in self.values:
            if own.why:
                key, _, member = own.name.partition(".")
                left.setdefault((key, own.why), []).append(f"{member} {readable(own.left, own.unit)}".strip())
        where = str(self.rig.path or "")
        return tuple(NO_KEY(Where(file=where), name=key, errors=errors, why=why) for (key, why), errors in left.items())

    def to_toml(self, more: Sequence[str] = ()) -> str:
        """Text of a rig file, whose first lines say what was updated, what is not in it, and `more`."""
        held = [f"#   {own.line()}" for own in self.values if not own.why]
        lines = [
            "# Values that were known to a tolerance, or are named as wrong, with the errors that records gave them:",
            *held,
        ]
        left = [own for own in self.values if own.why]
        if left:
            lines.append("# Not in this file, since no key holds it:")
            for own in left:
                rest = "" if own.left == own.error else f", of which is left {readable(own.left, own.unit)}"
                lines += [f"#   {own.line()}{rest}", f"#     {own.why}"]
        return "\n".join([*lines, *(f"# {line}" for line in more), "", self.rig.to_toml()])

    def save(self, path: str | Path, more: Sequence[str] = ()) -> None:
        """Write the rig file, with the comments that `to_toml` has.

        Raises
        ------
        InputError, OutputError
            If it cannot be written there.
        """
        with whole_file(Path(path)) as stream:
            stream.write(self.to_toml(more).encode())

    def to_json(self) -> dict[str, Any]:
        """Plain data, by name."""
        return {own.name: own.as_dict() for own in self.values}


def update_of(
    rig: Rig, parameters: Sequence[Parameter], covariance: FloatArray | None, effects: Sequence[Effect] = ()
) -> RigUpdate:
    """The update of a rig by the errors of its values among the parameters of a model, and by what effects correct."""
    known = {p.name: p for p in parameters if p.prior is not None}
    index = {p.name: i for i, p in enumerate(parameters)}
    new, values = rig, list[UpdatedValue]()

    def std_of(slot: str) -> float | None:
        variance = np.nan if covariance is None else float(covariance[index[slot], index[slot]])
        return float(np.sqrt(variance)) if np.isfinite(variance) else None

    for effect in effects:
        named = {p.name: parameters[index[effect.slot(p.name)]] for p in effect.parameters(rig)}
        corrected = effect.corrected(new, {name: p.value for name, p in named.items()})
        if corrected is not new:
            new = corrected
            values += [UpdatedValue(p.name, p.unit, None, p.value, std_of(p.name), 0.0, "") for p in named.values()]
    for effect in (*KNOWN, *instruments_among(known, rig)):
        own = {p.name: effect.slot(p.name) for p in effect.parameters(rig) if effect.slot(p.name) in known}
        errors = {name: known[slot].value for name, slot in own.items()}
        new, left = effect.updated(new, errors) if any(errors.values()) else (new, {})
        for name, slot in own.items():
            p, (rest, why) = known[slot], left.get(name, (0.0, ""))
            prior, is_left = float(p.prior or 0.0), abs(rest) > 1e-12  # not rounding
            values.append(UpdatedValue(slot, p.unit, prior, p.value, std_of(slot), rest * is_left, why * is_left))
    return RigUpdate(_as_well_known(new, rig), tuple(values))


def _as_well_known(new: Rig, rig: Rig) -> Rig:
    """The new rig with the tolerances of the other: where a key is given that was not, another one is typical."""
    stated = {key: rig.known_to(key) for key in TYPICAL if new.known_to(key) != rig.known_to(key)}
    return new.replace(tolerance=rig.tolerance.model_copy(update=stated)) if stated else new
