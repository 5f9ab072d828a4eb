"""The way from a base model to one with the missing effects: rank, refit the few best, add one, and begin again."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import chdtri

from ambid.diagnosis.advice import next_experiment
from ambid.diagnosis.comparison import compare
from ambid.diagnosis.drift import largest_change
from ambid.diagnosis.localisation import localise
from ambid.diagnosis.ranking import ALPHA, Candidate, Progress, Ranking, rank
from ambid.diagnosis.result import Diagnosis, Step
from ambid.effects import Effect
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification.refit import Fit, refit
from ambid.model import Model
from ambid.noise import Noise
from ambid.noise.fit import fit_percent
from ambid.noise.tones import OUTSTANDING
from ambid.record import Record

__all__ = ["Search"]

EQUALLY_GOOD = 9.2
"""Candidates whose J + PENALTY q is within this of the best cannot be told apart (99 % of a chi-squared with 2 dof)."""
SPREAD = 1.5
"""Standard deviation of J in units of sqrt(2 dof): the noise spectrum is estimated too."""
REFITTED = 5
MOST_EFFECTS = 5
LOST = 2.0
"""Misfit J/dof above which parameters that have left their start say nothing."""
MOST_RENEWALS = 3
RENEWED = 0.02
"""Relative change of J by renewing the noise that is small enough."""
MOST_BY_SHARE = 2
"""So many effects may be called an explanation by the share that they explain; more must reach the noise."""
EXPLAINED_SHARE = 0.985
"""Part of the excess misfit that a set of effects must explain where its own formulas are approximations."""
NEGLIGIBLE_SHARE = 0.01
"""Part of the explained misfit below which another effect may mend the formula of the first."""
PROMISING_SHARE = 0.1
"""Part of what is left that a score must predict to be worth a refit."""
WITHOUT_PERIODS = (
    "i_e does not repeat, or not often enough to see it: the noise is what no smooth response to i_e explains, and "
    "neither tones nor drift were looked for"
)
HOPELESS_SHARE = 0.3
"""A step that explains less than this of what is left does not lead to an explanation."""


class Search:
    """The way from the base model to the last one, and its ledger."""

    def __init__(
        self,
        base: Fit,
        nominal: Model,
        noise: Noise,
        validate: Sequence[Record],
        catalogue: Sequence[Effect],
        tolerance: float,
        say: Callable[[str], None],
        progress: Progress,
    ) -> None:
        self.base = self.fit = base
        self.reference = base  # with the disturbances that were added, and nothing else
        self.is_stopped = False
        self.nominal, self.noise, self.validate = nominal, noise, validate
        self.validation_noise: Noise | None = None
        self.catalogue, self.tolerance, self.say, self.progress = catalogue, tolerance, say, progress
        self.rivals: dict[str, list[Candidate]] = {}
        self.sets: dict[str, list[str]] = {}
        self.hopeless: Fit | None = None
        self.history: list[Step] = []
        self._note(self._rank())

    @property
    def added(self) -> tuple[Effect, ...]:
        """What the search has added to the model that it started from."""
        return self.fit.model.effects[len(self.base.model.effects) :]

    @property
    def dof(self) -> int:
        """Degrees of freedom of J."""
        return self.noise.lines - len(self.fit.model.names)

    @property
    def at_noise(self) -> float:
        """J up to which a model may be right."""
        return self.dof + 3.0 * SPREAD * np.sqrt(2.0 * self.dof)

    @property
    def fall(self) -> float:
        """By how much the effects have lowered J; disturbances left out, which have lines of their own."""
        return self.reference.cost - self.fit.cost

    @property
    def explained(self) -> float:
        """Part of the excess misfit of the base model that is explained, that of disturbances left out."""
        excess = self.reference.cost - self.dof
        return 1.0 if excess <= 0.0 else self.fall / excess

    def automatic(self, ask: Callable[[Ranking, Candidate], bool] | None) -> None:
        """Add what the data support most, again and again; then see whether each is still the best of its rivals."""
        self._add_best(ask)
        for effect in self.added[:-1]:  # the rivals of the last were refitted with all others in the model
            self._reconsider(effect)

    def _add_best(self, ask: Callable[[Ranking, Candidate], bool] | None) -> None:
        while len(self.added) < MOST_EFFECTS:
            ranking = self.history[-1].ranking
            tried = self._worth_refitting(ranking)
            if not tried:
                return
            order = self._refits(tried)
            if not order:
                return
            candidate, better = order[0]
            fall = self.fit.cost - better.cost
            if candidate.chance_of(min(fall, candidate.score)) > np.log(ALPHA / len(ranking.candidates)):
                return  # the refit brings less than the score promised
            if ask is not None and not ask(ranking, candidate):
                return
            if self.fit.cost > self.at_noise and fall < HOPELESS_SHARE * (self.fit.cost - self.dof):
                self.hopeless = better
                return
            self._take(better, fall, candidate.effect)
            self.rivals[candidate.effect.name] = [other for other, _ in order]
            self.sets[candidate.effect.name] = _alternatives(order)
            self._note(self._rank(), candidate)
            self._prune()

    def _reconsider(self, effect: Effect) -> None:
        """Refit the rivals of an effect beside all that was added after it, and take the best."""
        rest = self.fit.model.without(effect.name)
        here = {other.name for other in rest.effects}
        found = []
        for rival in self.rivals[effect.name]:
            if rival.effect.name == effect.name:
                found.append((rival, self.fit))
            elif rival.effect.name not in here:
                try:
                    found.append((rival, refit(rest.add(rival.effect, rival.start), self.noise)))
                except (UnstableLoopError, ModelError):
                    continue
        order = sorted(found, key=lambda pair: pair[1].criterion)
        del self.sets[effect.name]
        best, self.fit = order[0]
        self.sets[best.effect.name] = _alternatives(order)
        if best.effect.name != effect.name:
            self._note(self._rank(), added=best.effect.name, removed=effect.name)

    def as_told(self, chosen: Sequence[Effect]) -> None:
        """Add a person's own choice, in this order."""
        for effect in chosen:
            start = _with_effects_of(self.nominal, self.fit.model)
            ranking = rank(compare(self.fit.model, self.noise.records), [effect], noise=self.noise, start=start)
            if not ranking.candidates:
                why = ranking.skipped.get(effect.name, effect.physics)
                raise ModelError(f"{effect.name} cannot be added to this model ({why})")
            order = self._refits(ranking.candidates)
            if not order:
                raise ModelError(f"{effect.name}: no stable loop with it was found; leave it out")
            candidate, better = order[0]
            self._take(better, self.fit.cost - better.cost, candidate.effect)
            self._note(self._rank(), candidate)

    def _take(self, better: Fit, fall: float, added: Effect) -> None:
        """Go on from a better model; what a model that is far off leaves between the excited lines is no noise."""
        self.fit = better
        if added.frequencies_hz(better.model.rig):
            own = {
                p.name.split(".", 1)[1]: p.value for p in better.model.parameters if p.name.startswith(f"{added.name}.")
            }
            self.reference = refit(self.reference.model.add(added, own), self.noise)
        if fall <= self.dof:
            return
        for _ in range(MOST_RENEWALS):
            before = self.fit.cost
            self.noise = Noise(self.fit.model, self.noise.records)
            self.fit = refit(self.fit.model, self.noise)
            if abs(self.fit.cost / before - 1.0) < RENEWED:
                break
        self.base, self.reference = self._judged_again(self.base), self._judged_again(self.reference)

    def _judged_again(self, fit: Fit) -> Fit:
        """The same model in the present noise."""
        residual = self.noise.residual(fit.model)
        return Fit(fit.model, float(residual @ residual))

    def _rank(self) -> Ranking:
        """From the fit, or, where misfit has driven its parameters off, from where the diagnosis began."""
        start = _with_effects_of(self.nominal, self.fit.model)
        is_lost = self.fit.cost > LOST * self.dof and self._is_driven_off() and start.is_stable
        comparison = compare(start if is_lost else self.fit.model, self.noise.records)
        return rank(comparison, self.catalogue, noise=self.noise, start=start, progress=self.progress)

    def _worth_refitting(self, ranking: Ranking) -> list[Candidate]:
        """The significant candidates whose score is at least half of the best, since scores can err by that much.

        Where far more than noise is left, they must promise to explain a tenth of it.
        What is left beside an effect that explains a hundred times as much may be the error of its formula: then only
        what explains most of that is worth it.
        """
        significant = ranking.significant
        best = max((candidate.score for candidate in significant), default=0.0)
        small = best < NEGLIGIBLE_SHARE * self.fall
        minor = self.fit.cost < self.at_noise or best < 0.5 * (self.fit.cost - self.dof)
        if self.added and small and minor:
            return []
        least = 0.5 * best
        if self.fit.cost > self.at_noise:
            least = max(least, PROMISING_SHARE * (self.fit.cost - self.dof))
        return [candidate for candidate in significant if candidate.score >= least][:REFITTED]

    def _refits(self, tried: Sequence[Candidate]) -> list[tuple[Candidate, Fit]]:
        """Each candidate added and refitted, the best first.

        They start from the predicted values; where the base model is far off, from the rig file's too.
        """
        found: list[tuple[Candidate, Fit]] = []
        for done, candidate in enumerate(tried):
            self.progress(f"refitting {candidate.effect.name}", done, len(tried))
            best = min((other.cost for _, other in found), default=np.inf)
            if best < self.at_noise and self.fit.cost - 2.0 * candidate.score > best + EQUALLY_GOOD:
                continue  # even twice the predicted fall would not do
            starts = [(self.fit.model, candidate.start)]
            if candidate.from_start or self.fit.cost > 20.0 * self.dof or self._is_driven_off():
                starts.append((_with_effects_of(self.nominal, self.fit.model), candidate.start))
            starts.append((self.fit.model, {}))  # typical small values, where the predicted ones make no stable loop
            ends: list[Fit] = []
            for base, values in starts:
                try:
                    ends.append(refit(base.add(candidate.effect, values), self.noise))
                except (UnstableLoopError, ModelError, ValueError):
                    continue
                if ends[-1].cost < self.at_noise or len(ends) == len(starts) - 1:
                    break
            if ends:
                found.append((candidate, min(ends, key=lambda end: end.cost)))
        return sorted(found, key=lambda pair: pair[1].criterion)

    def _is_driven_off(self) -> bool:
        """Whether a parameter of the base model has left its start by more than a factor of two."""
        now = {p.name: p.value for p in self.fit.model.parameters}
        start = {p.name: p.value for p in self.nominal.parameters if p.name in now and p.value > 0.0}
        return any(not 0.5 < now[name] / value < 2.0 for name, value in start.items())

    def _prune(self) -> None:
        """Take out effects that a later one has made needless."""
        for effect in self.added[:-1]:
            try:
                less = refit(self.fit.model.without(effect.name), self.noise)
            except UnstableLoopError:
                continue  # no loop without it
            degrees = len(self.fit.model.names) - len(less.model.names)
            if less.cost - self.fit.cost < chdtri(degrees, ALPHA):
                del self.sets[effect.name]
                self.fit = less
                self._note(self._rank(), removed=effect.name)

    def _note(
        self,
        ranking: Ranking,
        predicted: Candidate | None = None,
        *,
        added: str | None = None,
        removed: str | None = None,
    ) -> None:
        validation = None
        if self.validate:
            if self.validation_noise is None or removed is None:
                self.validation_noise = Noise(self.fit.model, self.validate)
            residual = self.validation_noise.residual(self.fit.model)
            validation = float(residual @ residual) / self.validation_noise.lines
        step = Step(
            effects=tuple(effect.name for effect in self.fit.model.effects),
            fit_percent=_fits(self.fit.model, self.noise.records),
            validation_fit_percent=_fits(self.fit.model, self.validate) if self.validate else None,
            misfit=self.fit.cost / self.dof,
            validation_misfit=validation,
            predicted_misfit=None if predicted is None else predicted.predicted_misfit,
            ranking=ranking,
            model=self.fit.model,
            removed=removed,
            added=added if predicted is None else predicted.effect.name,
        )
        self.history.append(step)
        self.noted = (self.fit, self.base, self.reference, self.noise)
        self.say(step.line())

    def _is_at_noise(self) -> bool:
        """Whether nothing but noise is left; a record of the same amplitude that was kept back adds to the evidence."""
        above = (self.fit.cost - self.dof) / (SPREAD * np.sqrt(2.0 * self.dof))
        kept_back = self.history[-1].validation_misfit
        if kept_back is None or self.validation_noise is None or self._validated():
            return bool(above < 3.0)
        other = (kept_back - 1.0) * np.sqrt(self.validation_noise.lines / 2.0) / SPREAD
        return bool(above < 3.0 and above + other < 3.0 * np.sqrt(2.0))

    def stop(self) -> None:
        """Go back to the last step that was finished."""
        self.is_stopped = True
        self.fit, self.base, self.reference, self.noise = self.noted

    def _others(self) -> str:
        """What the model was held against beside one amplitude at one operating point."""
        if self.base.model.points:
            return "operating points"
        amplitudes = [float(r.i_e.std()) for r in self.noise.records if r.i_e is not None]
        return "amplitudes" if self._validated() or max(amplitudes) > 1.2 * min(amplitudes) else ""

    def _validated(self) -> bool:
        """Whether a record to validate on has another amplitude than all others."""
        own, other = (
            [float(r.i_e.std()) for r in records if r.i_e is not None]
            for records in (self.noise.records, self.validate)
        )
        return any(all(abs(a / b - 1.0) > 0.2 for b in own) for a in other)

    def verdict(self, begun: float) -> Diagnosis:
        """What the search came to."""
        misfit, share = self.fit.cost / self.dof, self.explained
        effects = tuple(effect.name for effect in self.added)
        where = localise(self.base.model, self.noise)
        notes, sets = [], [self.sets[name] for name in effects if len(self.sets.get(name, ())) > 1]
        left = Noise(self.fit.model, self.noise.records) if effects else self.noise
        change = largest_change(self.fit.model, left) if effects else where.change
        strong = [tone for tones in left.tones for tone in tones if tone.power > OUTSTANDING]
        unexplained = [f"a tone at {tone.frequency_hz:.2f} Hz is left" for tone in strong]
        unexplained += [f"{change.parameter} changes during the record"] if change is not None else []
        by_share = share > EXPLAINED_SHARE and len(effects) <= MOST_BY_SHARE
        if not effects and misfit < self.tolerance and not unexplained:
            verdict = "adequate"
        elif effects and (self._is_at_noise() or by_share) and not unexplained:
            verdict = "ambiguous" if sets else "explained"
            if misfit > self.tolerance:
                notes.append(
                    f"the effects explain {100 * share:.1f} % of the excess misfit; J/dof {misfit:.2f} remains, since "
                    "their formulas only approximate this machine"
                )
        elif self.is_stopped:
            verdict = "not_informative"
        else:
            verdict = "none_of_the_candidates"
            best = self.fit if self.hopeless is None else self.hopeless
            tried = best.model.effects[len(self.base.model.effects) :]
            if tried:
                names = ", ".join(effect.name for effect in tried)
                share = (self.base.cost - best.cost) / (self.base.cost - self.dof)
                notes.append(f"best tried: {names}, which explains {100 * share:.0f} % of the excess misfit; not added")
            notes += [*unexplained, where.sentence()]
            self.fit, effects, sets = self.base, (), []
        pairs = zip(self.noise.records, self.noise.whiteners, strict=True)
        notes += [f"{record.name}: {WITHOUT_PERIODS}" for record, w in pairs if not w.window.is_periodic]
        if self.is_stopped:
            notes.append("stopped by Ctrl-C after the steps above: more may be missing, and rivals were not compared")
        return Diagnosis(
            verdict=verdict,
            effects=effects,
            ambiguous_sets=sets,
            history=self.history,
            localisation=where,
            model=self.fit.model.with_substeps(None),
            records=self.noise.records,
            validation=tuple(self.validate),
            next_experiment=next_experiment(verdict, sets, where, self.history, others=self._others()),
            seconds=time.perf_counter() - begun,
            notes=tuple(note for note in notes if note),
        )


def _alternatives(order: Sequence[tuple[Candidate, Fit]]) -> list[str]:
    """Names of the candidates that do as well as the best; none that only contains a simpler one of them."""
    best = order[0][1]
    equal = [candidate.effect for candidate, other in order if other.criterion <= best.criterion + EQUALLY_GOOD]
    names = {effect.name for effect in equal}
    return [effect.name for effect in equal if not names & set(effect.contains)]


def _with_effects_of(nominal: Model, model: Model) -> Model:
    """The nominal values of the base parameters, the present ones of the effects."""
    own = {p.name: p.value for p in nominal.parameters if p.name in model.names}
    return model.with_values(own)


def _fits(model: Model, records: Sequence[Record]) -> dict[str, float]:
    channels = [c for c in records[0].channels if all(c in r.channels for r in records)]
    simulated = [model.response(record) for record in records]
    return fit_percent(channels, [r.outputs for r in records], simulated)
