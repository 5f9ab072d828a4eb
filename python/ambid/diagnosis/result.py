"""What a diagnosis found: verdict, effects, the ledger of steps, and where the model fails."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ambid.arrays import ByValue, FloatArray
from ambid.diagnosis.candidates import Ranking
from ambid.diagnosis.localisation import Cell, Localisation, MisfitMap, misfit_maps
from ambid.diagnosis.moves import REPORTED, Moved
from ambid.diagnosis.probabilities import Probabilities
from ambid.effects import CATALOGUE, Effect
from ambid.findings import NOWHERE, Finding, Kind, WithFindings
from ambid.identification import ParameterEstimate
from ambid.identification.tolerances import Budget, KnownValue
from ambid.identification.tolerances import lines as tolerance_lines
from ambid.model import Model
from ambid.noise import Adequacy, Comparison
from ambid.noise.compared import averaged_over
from ambid.noise.window import findings_of
from ambid.record import Measurement
from ambid.results import Named, OfParameters, Tabular, band_text, picture, plain
from ambid.rig import Rig

VERDICTS = {
    "adequate": "nothing is missing that these data can show, in this band and at this amplitude",
    "explained": "the effects named explain the misfit",
    "ambiguous": "one of the effects of each set explains the misfit; these data cannot determine which",
    "none_of_the_candidates": "something is missing that no effect of the catalogue explains; nothing was added",
    "not_informative": "these data cannot decide",
}

EXPLAINED = (
    "the effects explain {explained:.1f|%} of the excess misfit, but "
    "[misfit {misfit:{limit}|against} remains, limit {limit:{misfit}|against} (J/dof)]"
    "[{ratio:{most}|against} times the power of the noise remains {when}, limit {most:{ratio}|against}]"
)
MOSTLY_EXPLAINED = Kind(
    "mostly_explained",
    "warning",
    f"mostly explained: {EXPLAINED}; their formulas only approximate this machine, or something smaller is missing, "
    "and the intervals may not contain the true values",
)
EXPLAINED_BY_POINT = Kind(
    "explained_point_by_point",
    "warning",
    f"mostly explained: {EXPLAINED}; each operating point by itself is explained to the noise, with other values of "
    "what all points share",
)
GOOD_ENOUGH = Kind(
    "good_enough",
    "note",
    "good enough: misfit {misfit:{by_chance}|against} (J/dof) remains, within the {tolerance:{misfit}|against} that is "
    "asked for, but above the {by_chance:{misfit}|against} that chance brings: something small is missing, most of it "
    "in {channel} from {low_hz:.4g} to {high_hz:.4g} Hz ({cell_misfit:.1f} times noise)",
)
MEANINGS = (MOSTLY_EXPLAINED, EXPLAINED_BY_POINT, GOOD_ENOUGH)
"""Findings that take the place of the verdict's meaning, where more than noise is left."""
STOPPED = Kind("search_stopped", "warning", "stopped before the end: more may be missing, and rivals were not compared")
MEND = Kind(
    "next_mend",
    "note",
    "first mend what the findings name, then record again with an excitation that is designed within the limits of the "
    "machine",
)


@dataclass(frozen=True)
class Family:
    """An effect and its near twins in these data.

    Attributes
    ----------
    members : tuple of str
    shared : str
        What all of them bring, such as ``a lag of 3.0 ms round the loop``; empty where there is no such thing.
    values : tuple of float
        The same as a number of each member, in `unit`; NaN where it is no one number, empty where there is none.
    unit : str
    """

    members: tuple[str, ...]
    shared: str
    values: tuple[float, ...] = ()
    unit: str = ""

    def line(self) -> str:
        """In words, such as ``a lag of 3.0 ms round the loop: sensor_lag or loop_delay``."""
        *others, last = self.members
        return f"{self.shared or 'near twins'}: {', '.join(others)} or {last}"

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "members": list(self.members),
            "shared": self.shared,
            "values": list(self.values),
            "unit": self.unit,
        }


@dataclass(frozen=True)
class Step:
    """One line of the ledger: the model after a step.

    Attributes
    ----------
    effects : tuple of str
        In the model, in the order of their adding.
    fit_percent, validation_fit_percent : dict
        Per channel and ``average``; None without records to validate on.
    misfit, validation_misfit : float
        J/dof.
    predicted_misfit : float or None
        What the ranking before predicted for the effect that was added.
    ranking : Ranking
        Of what is still outside the model.
    model : Model
        With the values of all parameters.
    moved : tuple of Moved
        Parameters of the step before, those that this one moved by most standard errors first.
    removed : str or None
        Effect that this step took out again.
    added : str or None
        Effect that this step added.
    """

    effects: tuple[str, ...]
    fit_percent: dict[str, float]
    validation_fit_percent: dict[str, float] | None
    misfit: float
    validation_misfit: float | None
    predicted_misfit: float | None
    ranking: Ranking
    model: Model
    moved: tuple[Moved, ...] = ()
    removed: str | None = None
    added: str | None = None

    @property
    def change(self) -> str:
        """What the step did, such as ``+ loop_delay - amplifier_bandwidth``."""
        changes = [f"{sign} {name}" for sign, name in (("+", self.added), ("-", self.removed)) if name]
        return " ".join(changes) or "base model"

    def line(self) -> str:
        """One line of text."""
        fit = f"fit of {averaged_over(self.fit_percent)} {self.fit_percent['average']:6.2f} %"
        text = f"{self.change:36s} misfit {self.misfit:10.3f}   {fit}"
        if self.predicted_misfit is not None:
            text += f"   (predicted {self.predicted_misfit:.3f})"
        if self.validation_misfit is not None and self.validation_fit_percent is not None:
            text += f"   validation {self.validation_misfit:.3f}, {self.validation_fit_percent['average']:.2f} %"
        return text

    def moves(self, most: int = 4) -> list[str]:
        """Which parameters the step moved most, beyond `REPORTED` standard errors, a line each."""
        return [f"  {self.change} moved {own.line()}" for own in self.moved[:most] if abs(own.errors) > REPORTED]

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return {
            "effects": list(self.effects),
            "fit_percent": self.fit_percent,
            "validation_fit_percent": self.validation_fit_percent,
            "misfit": self.misfit,
            "validation_misfit": self.validation_misfit,
            "candidates": [candidate.as_dict() for candidate in self.ranking.candidates],
            "moved": [own.as_dict() for own in self.moved],
        }


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(ByValue, OfParameters[ParameterEstimate], WithFindings, Tabular):
    """Result of `diagnose`.

    Attributes
    ----------
    verdict : str
        One of `VERDICTS`.
    effects : tuple of str
        Added, in order.
    ambiguous_sets : list of list of str
        Effects that these data cannot distinguish.
    probabilities : Probabilities
        Of every set that was tried, of effects, of nothing and of something else.
    history : list of Step
    localisation : Localisation or None
        Where the base model fails.
    fit : Comparison or None
        The last model against the records; None where the diagnosis could not begin.
    kept_back : Comparison or None
        The last model that was tried against the records for validation.
    parameters : dict of str to ParameterEstimate
        Of the last model, with standard errors and 95 % intervals as `identify` gives them.
    covariance : ndarray
        Of all its parameters.
    tolerances : dict of str to KnownValue
        Values of the rig file that are known to a tolerance, as `identify` gives them.
    variances : dict of str to dict of str to float
        See `budget`.
    explained_percent : float
        Part of the excess misfit of the base model over noise that the effects explain, 0 to 100, both judged in one
        noise; 100 where the base model has no excess; NaN where nothing was named.
    families : dict of str to Family
        Near twins of each named effect.
    model : Model
        The last model.
    records, validation : tuple of Record or FrequencyResponse
        That were diagnosed, and that were kept to judge by.
    next_steps : tuple of Finding
        What to do now, by their codes.
    seconds : float
    findings : tuple of Finding
    adequacy : Adequacy
        Of the last model, with lines, drift and the records for validation.
    """

    verdict: str
    effects: tuple[str, ...]
    ambiguous_sets: list[list[str]]
    probabilities: Probabilities
    history: list[Step]
    localisation: Localisation | None
    model: Model
    fit: Comparison | None
    kept_back: Comparison | None
    parameters: dict[str, ParameterEstimate]
    covariance: FloatArray
    explained_percent: float
    families: dict[str, Family]
    records: tuple[Measurement, ...]
    validation: tuple[Measurement, ...]
    next_steps: tuple[Finding, ...]
    seconds: float
    findings: tuple[Finding, ...] = ()
    adequacy: Adequacy = Adequacy()
    tolerances: dict[str, KnownValue] = field(default_factory=dict)
    variances: Budget = field(default_factory=dict)
    incidental = ("seconds",)

    @classmethod
    def uninformative(
        cls, model: Model, records: Sequence[Measurement], why: Sequence[Finding], begun: float
    ) -> Diagnosis:
        """A diagnosis that could not begin."""
        return cls(
            verdict="not_informative",
            effects=(),
            ambiguous_sets=[],
            probabilities=Probabilities(),
            history=[],
            localisation=None,
            model=model,
            fit=None,
            kept_back=None,
            parameters={
                p.name: ParameterEstimate(p.value, None, None, p.unit) for p in model.parameters if p.prior is None
            },
            covariance=np.full((len(model.names), len(model.names)), np.nan),
            explained_percent=np.nan,
            families={},
            records=tuple(records),
            validation=(),
            next_steps=(MEND(NOWHERE),),
            seconds=time.perf_counter() - begun,
            findings=tuple(why),
        )

    plot = picture("plot_staircase")

    def mended(self) -> tuple[Measurement, ...]:
        """The records without the errors of theirs that are named: moved, scaled, turned and exchanged back.

        What the machine does stays in them, and frequency responses are as they were.
        """
        order = [effect.name for effect in CATALOGUE]  # of the errors of a record: the last to have come into it first
        effects = sorted(self.model.effects, key=lambda effect: effect.name in order and order.index(effect.name))
        values = {p.name: p.value for p in self.model.parameters}
        found = list(self.records)
        for effect in effects:
            own = {p.name: values[effect.slot(p.name)] for p in effect.parameters(self.model.rig)}
            found = [effect.mended(record, own) if record.is_in_time else record for record in found]
        return tuple(found)

    def budget(self) -> Budget:
        """Variance of every parameter of the last model by what it comes from, as `Estimate.budget` has it."""
        return self.variances

    @property
    def meaning(self) -> str:
        """What the verdict says, in a sentence; where more than noise is left, how much and where."""
        stopped = [finding.message for finding in self.findings if finding.kind is STOPPED]
        own = [finding.message for finding in self.findings if finding.kind in MEANINGS]
        return "; ".join([*stopped, *(own[:1] or [VERDICTS[self.verdict]])])

    @property
    def next_step(self) -> Finding:
        """The first of what to do now."""
        return self.next_steps[0]

    @property
    def next_experiment(self) -> str:
        """What to do now, in words."""
        return "; ".join(step.remedy or step.message for step in self.next_steps)

    @property
    def left(self) -> tuple[MisfitMap, ...]:
        """The misfit map of the last model, of every record: where nothing is left, it is 1 throughout."""
        return () if self.fit is None or not self.fit.is_judged else misfit_maps(self.fit)

    @property
    def where(self) -> tuple[Cell, ...]:
        """Cells of the misfit map of the base model, largest misfit first."""
        return () if self.localisation is None else self.localisation.cells

    @property
    def not_tried(self) -> dict[str, str]:
        """Effects that make no sense on this rig or could not be judged in the first ranking, and why."""
        return self.history[0].ranking.not_tried if self.history else Named()

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        return plain(
            {
                "verdict": self.verdict,
                "verdict_meaning": self.meaning,
                "effects": list(self.effects),
                "ambiguous_sets": self.ambiguous_sets,
                "probabilities": self.probabilities.as_dict(),
                "sets": [own.as_dict() for own in self.probabilities.sets],
                "history": [step.as_dict() for step in self.history],
                "where": [
                    {
                        "record": c.record,
                        "channel": c.channel,
                        "band_hz": list(c.band_hz),
                        "misfit": c.misfit,
                        "kind": c.kind,
                    }
                    for c in self.where[:20]
                ],
                "left": [own.as_dict() for own in self.left],
                "parameters": {name: p.as_dict() for name, p in self.parameters.items()},
                "tolerances": {name: known.as_dict() for name, known in self.tolerances.items()},
                "budget": self.variances,
                "misfit": np.nan if self.fit is None else self.fit.misfit,
                "misfit_bound": np.nan if self.fit is None else self.fit.bound,
                "adequacy": self.adequacy.as_dict(),
                "explained_percent": self.explained_percent,
                "families": {name: family.as_dict() for name, family in self.families.items()},
                "not_tried": self.not_tried,
                "next_experiment": self.next_experiment,
                "next_steps": [step.as_dict() for step in self.next_steps],
                "seconds": self.seconds,
                "findings": [finding.as_dict() for finding in self._to_report],
                "notes": [finding.line() for finding in self._to_report],
            }
        )

    def table(self) -> dict[str, list[Any]]:
        """Steps of the ledger, a row each."""
        steps = self.history
        return {
            "model": [", ".join(step.effects) or "base model" for step in steps],
            "misfit": [step.misfit for step in steps],
            "predicted_misfit": [step.predicted_misfit for step in steps],
            "fit_percent": [step.fit_percent["average"] for step in steps],
            "validation_misfit": [step.validation_misfit for step in steps],
            "validation_fit_percent": [(step.validation_fit_percent or {}).get("average") for step in steps],
        }

    def summary(self) -> list[str]:
        """Verdict, what it means, what to do next, and the findings."""
        named = f": {', '.join(self.effects)}" if self.effects else ""
        sets = [f"cannot be distinguished: {', '.join(names)}" for names in self.ambiguous_sets]
        verdict = f"verdict: {self.verdict}{named}; {self.meaning}"
        families = [family.line() for family in self.families.values()]
        return [
            verdict,
            *sets,
            *families,
            *self.probabilities.lines(),
            f"next: {self.next_experiment}",
            *(finding.line() for finding in self._further),
        ]

    @property
    def _to_report(self) -> tuple[Finding, ...]:
        """What is to be known of the records, then the findings."""
        of_records = (finding for record in self.records for finding in findings_of(record))
        return tuple(dict.fromkeys([*of_records, *self.findings]))

    @property
    def _further(self) -> list[Finding]:
        """All of these but that which is the meaning."""
        return [finding for finding in self._to_report if finding.kind not in (*MEANINGS, STOPPED)]

    def save(self, path: str | Path) -> None:
        """Write the last model with its covariance, for ``--model`` and `Model.load`."""
        self.model.save(path, self.covariance)

    def __str__(self) -> str:
        named = f": {', '.join(self.effects)}" if self.effects else ""
        lines = [f"verdict: {self.verdict}{named}", f"  {self.meaning}"]
        lines += [f"  cannot be distinguished: {', '.join(names)}" for names in self.ambiguous_sets]
        lines += [
            f"  {line}" for line in (*(own.line() for own in self.families.values()), *self.probabilities.lines())
        ]
        lines += ["", *(step.line() for step in self.history)]
        lines += [line for step in self.history for line in step.moves()]
        if self.history:
            here = self.model
            of_effects = {e.slot(p.name): f"   {p.meaning}" for e in here.effects for p in e.parameters(here.rig)}
            lines += ["", "parameters of the last model, 95 % intervals:"]
            lines += [f"  {name:34s} {p.line()}{of_effects.get(name, '')}" for name, p in self.parameters.items()]
            lines += [line for effect in here.effects for line in _settings(effect, here.rig)]
        if self.tolerances:
            lines += ["", *tolerance_lines(self.tolerances, self.variances)]
        worst = [cell for cell in self.where[:3] if np.isfinite(cell.misfit)]
        if worst and self.verdict != "adequate":
            lines += ["", "largest misfit of the model at the start:"]
            lines += [f"  {c.channel:12s} {band_text(*c.band_hz):>14s} Hz: {c.misfit:.1f} times noise" for c in worst]
        if self.not_tried:
            lines += ["", f"not tried: {'; '.join(f'{name} ({why})' for name, why in self.not_tried.items())}"]
        lines += ["", f"next: {self.next_experiment}", *(f"{own.severity}: {own.line()}" for own in self._further)]
        return "\n".join(lines)


def _settings(effect: Effect, rig: Rig) -> Iterator[str]:
    """What was found beside the parameters of an effect: its place, its frequency, and what its angle counts from."""
    for label, (value, unit) in effect.fine_settings().items():
        yield f"  {label:34s} {value:.6g} {unit}   where the misfit is least"
    if effect.quarters(rig):
        channels = [f"{signal}.{axis}" for signal in ("y", "i_c") for axis in rig.axes]
        channel = channels[effect.settings().get("reference", 0) % len(channels)]
        yield f"  {f'{effect.name}, angle':34s} counted from the wave in {channel}"
