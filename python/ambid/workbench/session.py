"""What a person does with a model, one step at a time: a chain of finished steps, each made by one public function.

A step never changes. To undo is to go on from the one before; the chain is what the exported script runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from ambid.diagnosis import Localisation, Ranking, localise, rank
from ambid.diagnosis.ranking import Progress, silent
from ambid.errors import ModelError, UnstableLoopError
from ambid.identification import Estimate, identify
from ambid.model import Model
from ambid.noise import Comparison, compare
from ambid.record import Measurement

KEPT = 8
"""Maps that are kept, for steps that are shown again; each holds a comparison with its records."""
AGAIN = "\nkept_back = ambid.compare(comparison.model, validate) if validate else None"
MOVED = "\nkept_back = kept_back.of(comparison.model).with_own_angles() if validate else None"


@dataclass(frozen=True)
class Bench:
    """What stays the same while a person works.

    Attributes
    ----------
    start : Model
        Where the work begins.
    records : tuple of Record or FrequencyResponse
        To fit and to choose by.
    validate : tuple of Record or FrequencyResponse
        Nothing is fitted to them, nothing chosen by them.
    model_file : Path or None
        That the start was read from; None where it is the rig file's.
    read_with : str
        Further arguments of `load_measurement` that the records were read with, in Python.
    """

    start: Model
    records: tuple[Measurement, ...]
    validate: tuple[Measurement, ...] = ()
    model_file: Path | None = None
    read_with: str = ""


@dataclass(frozen=True)
class Session:
    """A finished step, and through `before` all that led to it.

    Attributes
    ----------
    bench : Bench
    comparison : Comparison
        The model of this step against the records.
    kept_back : Comparison or None
        The same against the records to validate on; None without any.
    did : str
        What this step did, such as ``+ seal_forces``.
    code : str
        The lines of Python that do it, on the `comparison` and `kept_back` of the step before.
    before : Session or None
    estimate : Estimate or None
        Where the step was a fit.
    ranking : Ranking or None
        Of what the model lacks, once it was asked for.
    predicted_misfit : float or None
        What the ranking before promised of the effect that was added.
    """

    bench: Bench
    comparison: Comparison
    kept_back: Comparison | None
    did: str
    code: str
    before: Session | None = None
    estimate: Estimate | None = None
    ranking: Ranking | None = None
    predicted_misfit: float | None = None

    @classmethod
    def begin(cls, bench: Bench) -> Session:
        """Compare the start with the records; where its loop is unstable, fit it first.

        Raises
        ------
        RecordError
            If the noise of a record is not known, so that nothing could be judged; and as for `compare`.
        UnstableLoopError
            If no stable start is found either.
        """
        start = bench.start.covering(bench.records)
        try:
            comparison, estimate = compare(start, bench.records), None
            did, code = "start", "comparison = ambid.compare(model, records)"
        except UnstableLoopError:
            estimate = identify(start, bench.records)
            comparison = estimate.comparison
            did, code = "fit, as the start is unstable", "comparison = ambid.identify(model, records).comparison"
        kept_back = _kept_back(bench, comparison.model)
        for own in (comparison, kept_back):
            if own is not None:
                own.noise  # noqa: B018  refuses records whose noise is not known
        return cls(bench, comparison, kept_back, did, code + AGAIN, estimate=estimate)

    @property
    def model(self) -> Model:
        """As it stands."""
        return self.comparison.model

    @property
    def chain(self) -> list[Session]:
        """All steps up to this one, the first one first."""
        return [*(() if self.before is None else self.before.chain), self]

    @property
    def fitted(self) -> Estimate | None:
        """The last fit that led here."""
        return next((step.estimate for step in reversed(self.chain) if step.estimate is not None), None)

    @property
    def validation_misfit(self) -> float | None:
        """J/dof of the records to validate on; none of the parameters was fitted to them."""
        if self.kept_back is None:
            return None
        return self.kept_back.cost / (self.kept_back.dof + len(self.kept_back.model.names))

    @property
    def where(self) -> Localisation:
        """Where the model of this step misses the records."""
        return _where(self.comparison)

    @property
    def where_kept_back(self) -> Localisation | None:
        """The same of the records to validate on."""
        return None if self.kept_back is None else _where(self.kept_back)

    def fit(self, progress: Progress = silent) -> Session:
        """Fit all parameters, from where they are.

        Raises
        ------
        UnstableLoopError
            If the loop is unstable at every start.
        """
        return self._fitted(self.model, "fit", "comparison.model", progress)

    def ranked(self, progress: Progress = silent) -> Session:
        """The same step with its ranking.

        Raises
        ------
        ModelError
            If the parameters are not those of a fit: scores are judged where a fit has ended.
        """
        if self.estimate is None:
            raise ModelError("the parameters of this model are not fitted; fit first, then rank")
        return self if self.ranking is not None else replace(self, ranking=rank(self.comparison, progress=progress))

    def add(self, name: str, progress: Progress = silent) -> Session:
        """Add a candidate at the values that the ranking predicts, and fit.

        Raises
        ------
        ModelError
            If the model is not fitted, or no candidate of the ranking has this name.
        UnstableLoopError
            If there is no stable loop with it.
        """
        ranking = self.ranked(progress).ranking
        assert ranking is not None
        candidate = ranking.find(name)
        if candidate is None:
            names = ", ".join(other.effect.name for other in ranking.candidates)
            raise ModelError(f"{name}: {ranking.not_tried.get(name, f'no candidate here; these are: {names}')}")
        model = self.model.add(candidate.effect, candidate.start)
        found = f"candidate = ambid.rank(comparison).find({name!r})\n"
        added = self._fitted(
            model, f"+ {name}", "comparison.model.add(candidate.effect, candidate.start)", progress, found
        )
        return replace(added, predicted_misfit=candidate.predicted_misfit)

    def remove(self, name: str, progress: Progress = silent) -> Session:
        """Take an effect out, and fit what is left.

        Raises
        ------
        ModelError
            If it is not in the model.
        UnstableLoopError
            If there is no stable loop without it.
        """
        return self._fitted(self.model.without(name), f"- {name}", f"comparison.model.without({name!r})", progress)

    def move(self, name: str, value: float) -> Session:
        """Give one parameter another value; nothing is fitted, and the noise stays.

        Raises
        ------
        ModelError
            If there is no such parameter, or physics does not allow the value.
        UnstableLoopError
            If the loop is unstable there.
        """
        if name not in self.model.names:
            raise ModelError(f"{name}: no such parameter; the model has {', '.join(self.model.names)}")
        model = self.model.with_values({name: value})
        unit = model.parameters[model.names.index(name)].unit
        comparison = self.comparison.of(model)
        comparison.cost  # noqa: B018  refuses an unstable loop
        return Session(
            self.bench,
            comparison,
            None if self.kept_back is None else self.kept_back.of(model).with_own_angles(),
            f"{name} = {value:.6g} {unit}",
            f"comparison = comparison.of(comparison.model.with_values({{{name!r}: {float(value)!r}}})){MOVED}",
            before=self,
        )

    def undo(self) -> Session:
        """The step before; the first one stays.

        Raises
        ------
        ModelError
            If nothing was done yet.
        """
        if self.before is None:
            raise ModelError("nothing was done yet that could be undone")
        return self.before

    def _fitted(self, model: Model, did: str, start: str, progress: Progress, found: str = "") -> Session:
        estimate = identify(
            model, self.bench.records, progress=lambda count, _: progress("fitting, evaluation", count, 0)
        )
        return Session(
            self.bench,
            estimate.comparison,
            _kept_back(self.bench, estimate.model),
            did,
            f"{found}comparison = ambid.identify({start}, records).comparison{AGAIN}",
            before=self,
            estimate=estimate,
        )


@lru_cache(maxsize=KEPT)
def _where(comparison: Comparison) -> Localisation:
    return localise(comparison)


def _kept_back(bench: Bench, model: Model) -> Comparison | None:
    return compare(model, bench.validate) if bench.validate else None
