"""The one yardstick J: where and by how much a model misses what was measured.

A `Comparison` holds a model, its records and their noise; all that is judged, fitted, ranked or reported is judged by
its J.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from functools import cached_property
from textwrap import shorten
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.channels import read_in
from ambid.errors import RecordError, UnstableLoopError
from ambid.findings import Finding, WithFindings
from ambid.loop.effect import Tone
from ambid.model import Given, Model, as_model
from ambid.model.operating_point import suffix
from ambid.noise.adequacy import Adequacy, Criterion, misfit_criterion
from ambid.noise.compared import ChannelComparison, RecordComparison, record_against, unjudged, with_average
from ambid.noise.halves import uneven
from ambid.noise.known import known_weights, tempered
from ambid.noise.lines import RecordLines
from ambid.noise.noise import Noise
from ambid.noise.response_lines import ResponseLines
from ambid.noise.unseen import LOUDER, OVER_CEILING, motion_left, power_left, shape_left
from ambid.noise.window import findings_of
from ambid.record import Measurement, Source, measured
from ambid.results import SHORT, Tabular, picture, plain
from ambid.threads import with_one_blas_thread

LOUDER_THAN_NOISE = {"power": OVER_CEILING, "motion": LOUDER}
SETTLED = 0.1
"""Fall of J at which they end: that of a right model scatters by more than one."""


class Comparison(WithFindings, Tabular):
    """All records against the model; result of `compare`. Immutable.

    Attributes
    ----------
    model : Model
    noise : Noise
        Of the records, by the residual of this model or of one before it.
    """

    def __init__(self, model: Model, records: Sequence[Measurement], noise: Noise | None = None) -> None:
        self.model, self._records, self._noise, self._why = model, tuple(records), noise, ""
        for record in self._records:
            record.require_rig(model.rig)
            if record.is_in_time:
                model.excitation(record)  # refuses a record without one
        if noise is None:
            try:
                self._noise = Noise(model, self._records)
            except RecordError as error:  # too short, or without noise: then what is left has no unit
                self._why = str(error)

    @property
    def noise(self) -> Noise:
        """The yardstick.

        Raises
        ------
        RecordError
            If the noise of a record is not known.
        """
        if self._noise is None:
            raise RecordError(self._why)
        return self._noise

    def __eq__(self, other: object) -> bool:
        """Whether the same model is held against the same records in the same noise."""
        if not isinstance(other, Comparison):
            return NotImplemented
        same = self.model == other.model and self._records == other._records
        return same and self._noise == other._noise and self._why == other._why

    def __hash__(self) -> int:
        return hash((self.model, self._records))

    def __getstate__(self) -> dict[str, Any]:
        """All but what is computed again."""
        return {name: self.__dict__[name] for name in ("model", "_records", "_noise", "_why")}

    def of(self, model: Model) -> Comparison:
        """Another model against the same records in the same noise."""
        return Comparison(model, self._records, self.noise)

    def with_own_angles(self) -> Comparison:
        """The same with the angle that waves of effects begin each record at, of records that nothing is fitted to.

        An unbalance or a hum is counted from what a channel holds of it, and that may be little beside a strong
        excitation; here each record determines the angle by all of its lines.
        """
        if not (self.is_judged and self._has_waves):
            return self
        return Comparison(self.model, self._records, self.noise.with_own_angles(self.model))

    @property
    def waves_differ(self) -> bool:
        """Whether waves of effects are in several records, which may begin them at angles of their own."""
        return self.is_judged and len(self.noise.in_time) > 1 and self._has_waves

    @property
    def _has_waves(self) -> bool:
        return any(effect.quarters(self.model.rig) for effect in self.model.acting)

    def renewed(self) -> Comparison:
        """The same model in the noise of its own residual.

        A nonlinear model whose loop is unstable at rest shapes no noise: there that of the model before stays.
        """
        try:
            return Comparison(self.model, self._records, self.noise.renewed(self.model))
        except UnstableLoopError:
            return self

    @cached_property
    def _judged(self) -> tuple[float, int]:
        found = self.noise.quadratic(self.model, [])
        return found.cost, found.fitted

    @cached_property
    def residual(self) -> FloatArray:
        """Whitened measured minus simulated, all records in a row; its sum of squares is J."""
        return self.noise.residual(self.model)

    @property
    def cost(self) -> float:
        """J: 2 per complex line and channel when the model is right."""
        return self._judged[0]

    @property
    def dof(self) -> int:
        """Degrees of freedom of J: judged numbers less parameters and transients."""
        return self.noise.lines - self._judged[1] - len(self.model.free)

    @property
    def misfit(self) -> float:
        """J/dof of all records: 1 when the model is right; NaN where the noise is not known."""
        return self.cost / self.dof if self._noise is not None else np.nan

    @property
    def by_chance(self) -> float:
        """Misfit that chance may bring to the right model at these degrees of freedom; NaN as `misfit`."""
        return self._against_bound.by_chance if self.is_judged else np.nan

    @property
    def bound(self) -> float:
        """Misfit up to which a model is good enough: `ADEQUATE`, or what chance may bring; NaN as `misfit`."""
        return self._against_bound.limit if self.is_judged else np.nan

    @property
    def _against_bound(self) -> Criterion:
        return misfit_criterion(self.misfit, self.dof, self.noise.scatter)

    @property
    def is_judged(self) -> bool:
        """Whether the noise is known."""
        return self._noise is not None

    @cached_property
    def adequacy(self) -> Adequacy:
        """Of the misfit, and of what it does not see in records without periods."""
        if not self.is_judged:
            return Adequacy()
        parts = [part for part in self.noise.in_time if not part.noise_is_measured]
        shapes = (own for part in parts if (own := shape_left(part, self.model)))
        return Adequacy.of([self._against_bound], self._powers(parts), shapes)

    def _powers(self, parts: Sequence[RecordLines]) -> Iterator[Criterion]:
        for part in parts:
            here = part.at(self.model)
            yield power_left(part, here)
            if own := motion_left(part, here):
                yield own

    @property
    def is_adequate(self) -> bool:
        """Whether nothing is left but noise, see `adequacy`."""
        return self.adequacy.is_adequate

    @property
    def inconsistency(self) -> Finding | None:
        """Which limit the model does not keep; None where it keeps all, or the noise is not known."""
        return self.adequacy.finding

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Which limit the model does not keep, and what is to be known of each record."""
        own = () if self.inconsistency is None else (self.inconsistency,)
        return (*own, *(finding for record in self.records for finding in record.findings))

    @property
    def held(self) -> tuple[float, ...]:
        """Mean current of each axis at the model's own operating point [A]; empty where it was not recorded."""
        in_time = [record for record in self._records if record.is_in_time]
        at_home = [record for record in in_time if not suffix(record.point or self.model.rig, self.model.rig)]
        measured = [record.i_c.mean(axis=0) for record in at_home if record.i_c is not None]
        return tuple(np.mean(measured, axis=0).tolist()) if measured else ()

    @property
    def tones(self) -> tuple[Tone, ...]:
        """What has a frequency of its own in the residual that the noise is from."""
        return tuple(tone for own in self.noise.tones for tone in own)

    @cached_property
    def records(self) -> tuple[RecordComparison, ...]:
        """Every record against the model."""
        found = []
        for k, record in enumerate(self._records):
            part = None if self._noise is None else self._noise.parts[k]
            own = unjudged(self.model, record) if part is None else record_against(self.model, part)
            findings = (*findings_of(record), *own.findings, *self._findings_in(own))
            found.append(replace(own, findings=findings))
        return tuple(found)

    def _findings_in(self, own: RecordComparison) -> Iterator[Finding]:
        """What is left of a record that the misfit does not show."""
        record = own.record
        if self.is_adequate and record.is_in_time and record.period is None:
            driven = self.model.excitation(record)[:, : len(record.axes)]
            if found := uneven(record, own.residual.real, driven):
                yield found
        for louder in self.adequacy.failed(*LOUDER_THAN_NOISE):
            if louder.where.record == record.name:
                yield LOUDER_THAN_NOISE[louder.name](louder.where, ratio=louder.statistic, **louder.values)

    @cached_property
    def fit_percent(self) -> dict[str, float]:
        """Fit of the channels that all records have, as one long record, and ``average`` over y.

        Of records in time; where there are none, of the frequency responses.
        """
        return self._pooled("fit_percent")

    @cached_property
    def noise_ceiling_percent(self) -> dict[str, float]:
        """Fit that the exact model would reach, likewise; NaN where the noise is not known."""
        return self._pooled("noise_ceiling_percent")

    def _pooled(self, which: str) -> dict[str, float]:
        pooled = [own for own in self.records if own.record.is_in_time] or self.records
        names = [c for c in pooled[0].record.channels if all(c in own.record.channels for own in pooled)]
        power, total = np.zeros(len(names)), np.zeros(len(names))
        for own in pooled:
            rows = [row for row in own.channels if row.channel in names]
            rows.sort(key=lambda row: names.index(row.channel))
            of_channels = np.isin(own.record.channels, names)
            numbers = own.record.samples if own.record.is_in_time else own.record.measured.sum(axis=(0, 2))[of_channels]
            measured = numbers * np.array([row.measured_rms for row in rows]) ** 2
            power += measured * (1.0 - np.array([getattr(row, which) for row in rows]) / 100.0) ** 2
            total += measured
        percent = 100.0 * (1.0 - np.sqrt(power / total))
        return with_average(dict(zip(names, percent.tolist(), strict=True)))

    @property
    def worst(self) -> tuple[str, ChannelComparison]:
        """The record and channel whose residual is largest in units of its noise."""
        pairs = [(r.record.name, c) for r in self.records for c in r.channels]
        return max(pairs, key=lambda pair: pair[1].residual_rms / pair[1].noise_rms if pair[1].noise_rms > 0 else 0.0)

    plot = picture("plot_comparison")
    plot_frequency_response = picture("plot_frequency_response")

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        records, adequacy = [record.as_dict() for record in self.records], self.adequacy.as_dict()
        return plain({"records": records, "adequacy": adequacy, **self.findings_as_dict()})

    def table(self) -> dict[str, list[Any]]:
        """Channels of all records, a row each."""
        rows = [(r.record.name, c) for r in self.records for c in r.channels]
        columns = [f.name for f in fields(ChannelComparison)]
        return {"record": [name for name, _ in rows]} | {
            column: [getattr(c, column) for _, c in rows] for column in columns
        }

    def summary(self) -> list[str]:
        """Misfit and notes of every record."""
        return [
            line
            for r in self.records
            for line in (
                f"{r.record.name}: misfit {r.misfit:.2f} (J/dof, 1 when the model is right)",
                *r.notes,
            )
        ]

    def __repr__(self) -> str:
        names = ", ".join(record.name for record in self._records)
        return f"Comparison({shorten(names, SHORT, placeholder=' ...')}: misfit {self.misfit:.2f})"

    def __str__(self) -> str:
        lines = []
        for record in self.records:
            width = max(len(read_in(c.unit)[1]) for c in record.channels)
            lines += [
                f"{record.record.name}: misfit {record.misfit:.2f} (J/dof, 1 when the model is right), "
                f"{100 * record.repeatable_share:.0f} % of the residual on excited lines repeats",
                f"{'channel':12s} {'fit %':>8s} {'ceiling %':>10s} {'residual rms':>{13 + width}s} "
                f"{'noise rms':>{11 + width}s} {'misfit':>8s}",
            ]
            for c in record.channels:
                factor, unit = read_in(c.unit)
                lines.append(
                    f"{c.channel:12s} {c.fit_percent:8.2f} {c.noise_ceiling_percent:10.2f} "
                    f"{c.residual_rms * factor:12.4g} {unit:{width}s} {c.noise_rms * factor:10.4g} {unit:{width}s} "
                    f"{c.misfit:8.2f}"
                )
        return "\n".join(lines)


@with_one_blas_thread
def compare(model: Given, records: Source | Sequence[Source]) -> Comparison:
    """Hold a model against what was measured, in units of the noise.

    Parameters
    ----------
    model : Model or Rig, or path of a rig file or saved model
        As it stands; nothing is fitted but the state that each record begins with, the angle at which each begins
        waves of effects, such as unbalance, and, of a model that no fit has moved, the errors of the values that its
        rig knows to a tolerance. A rig means its nominal values.
    records : Record or FrequencyResponse, path of a file, or sequence of them

    Returns
    -------
    Comparison

    Raises
    ------
    UnstableLoopError
        If the model's loop is unstable.
    RecordError
        If a record has other axes than the rig, or no excitation, or a response has channels that the loop lacks.
    """
    model = as_model(model)
    is_new = not model.structure.known
    model = model.with_tolerances()
    records = measured(records, model.rig)
    model = model.covering(records)
    with model.loop.naming_the_mode(model.theta):
        for record in records:
            if not record.is_in_time:  # refuses a loop that is unstable or lacks its channels
                ResponseLines(record, model).simulated(model.at(record))
        found = Comparison(model, records).with_own_angles()
        return _with_known_values(found) if is_new and found.is_judged else found


def _with_known_values(comparison: Comparison) -> Comparison:
    """The same with the values that are known to a tolerance where the records and the rig file together have them."""
    places = [i for i, p in enumerate(comparison.model.parameters) if p.prior is not None]
    best = comparison.of(comparison.model.opened())
    for _ in range(5 if places else 0):  # steps of Gauss and Newton to the errors of known values, at the most
        here, form = best.model, best.noise.quadratic(best.model, places)
        own = [here.parameters[i] for i in places]
        theta, weights = here.theta, known_weights(here, places)
        hessian, gradient, _ = tempered(form.hessian, form.gradient, form.cost, weights, theta[places], best.noise.size)
        theta[places] -= np.linalg.solve(hessian, gradient)
        theta[places] = np.clip(theta[places], [p.lower for p in own], [p.upper for p in own])
        trial = best.of(here.with_theta(theta))
        try:
            fall = best.cost - trial.cost
        except UnstableLoopError:
            break
        if fall > 0.0:
            best = trial
        if fall < SETTLED:
            break
    return best
