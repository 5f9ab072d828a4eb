"""The cheapest next experiment after an ambiguous verdict: what would distinguish hypotheses, and how clearly.

Of each experiment that may be made the record is simulated as each hypothesis would have it, beside the present one,
and every other hypothesis is fitted to both: what that fit leaves, J without noise, is the evidence lambda against it
(T-optimality; Atkinson and Fedorov 1975), S (1 - rho^2) where effects are small. `DISTINCT` decides in 95 % of records.

What a record is expected to show at all is the information that it brings of which hypothesis is true: with
probabilities p_k now and the lambda_kj that it adds, no less than

    I = -sum_k p_k log2 sum_j p_j exp(-lambda_kj / 8)    bits

(Kolchinsky and Tracey, Entropy 19 (2017) 361, by Bhattacharyya's distance of normal densities of one covariance).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from itertools import permutations
from typing import Any

import numpy as np

from ambid.arrays import FloatArray
from ambid.channels import by_signal
from ambid.designs.intervals import planned
from ambid.designs.peaks import Limits, forecast
from ambid.diagnosis import Diagnosis
from ambid.diagnosis.evidence import DISTINCT
from ambid.diagnosis.probabilities import NEGLIGIBLE
from ambid.errors import InputError, ModelError, RigError, UnstableLoopError
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.model import Model
from ambid.noise import Comparison
from ambid.noise.foreseen import Instruments, foreseen
from ambid.record import Record
from ambid.results import Tabular, plain
from ambid.rig import PidController, Rig
from ambid.threads import with_one_blas_thread

CURRENT_NOISE = 0.01
"""Rms of i_c [A] where it was not recorded: that of a common current probe."""
LOUDER = 1.1
"""Amplitude over the present one that is worth trying, at the least."""
NEARLY = 0.98
"""Part of the evidence wanted that ends the search for the length: two fits differ by as much."""


@dataclass(frozen=True)
class Change:
    """An experiment beside the one that was made.

    Attributes
    ----------
    what : str
        In words.
    amplitude : float
        Over the present one.
    rig : Rig or None
        At another operating point; None at the present one.
    record : tuple of str
        What is to be recorded that was not: ``i_c``, or further channels.
    """

    what: str
    amplitude: float = 1.0
    rig: Rig | None = None
    record: tuple[str, ...] = ()

    def at(self, model: Model) -> Model:
        """A model at the operating point of the experiment."""
        if self.rig is None:
            return model
        n = len(model.rig.axes)
        anything = Record("planned", model.rig.sample_rate, model.rig.axes, np.zeros((2, n)), np.zeros((2, n)), None)
        return model.covering([anything.at(self.rig)]).at(self.rig)


@dataclass(frozen=True)
class Proposal:
    """One experiment that could be made next.

    Attributes
    ----------
    change : Change
        What is different from the present one.
    evidence : float
        Least lambda of any hypothesis against any other, of both records together, the next as long as the present one.
    information : float
        That such a next record is expected to bring at the least, of which hypothesis is true [bits].
    repeats : float
        So many times as long as the present record must it be to distinguish them; infinite where no length would do.
    seconds : float
        That are to be recorded for that.
    load : float
        Largest peak over its limit.
    cost : float
        Seconds, setting up included.
    """

    change: Change
    evidence: float
    information: float
    repeats: float
    seconds: float
    load: float
    cost: float

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as in JSON."""
        return vars(self) | {"change": self.change.what}


@dataclass(frozen=True, repr=False)
class Proposals(Tabular):
    """What could be measured next, the cheapest first; result of `tell_apart` and `next_experiments`.

    Attributes
    ----------
    hypotheses : tuple of str
        That are to be distinguished.
    experiments : tuple of Proposal
    not_tried : dict of str to str
        Experiments that cannot be made, and why.
    unknown : float
        What is not known yet of which hypothesis is true [bits].
    """

    hypotheses: tuple[str, ...]
    experiments: tuple[Proposal, ...]
    not_tried: dict[str, str]
    unknown: float

    @property
    def best(self) -> Proposal | None:
        """The cheapest that would do, if there is one."""
        return next((own for own in self.experiments if np.isfinite(own.cost)), None)

    def table(self) -> dict[str, list[Any]]:
        """An experiment a row."""
        rows = [own.as_dict() for own in self.experiments]
        return {field.name: [row[field.name] for row in rows] for field in fields(Proposal)}

    def summary(self) -> list[str]:
        """What to do."""
        names = " from ".join(self.hypotheses)
        if self.best is None:
            most = max(self.experiments, key=lambda own: own.information, default=None)
            most_by = f"; {most.change.what} shows most" if most is not None else ""
            return [f"to distinguish {names}: none of these experiments would do{most_by}"]
        return [f"to distinguish {names}: {self.best.change.what}; {self.best.seconds:.3g} s are to be recorded"]

    def to_json(self) -> dict[str, Any]:
        """Plain data as the command's ``--json`` writes it."""
        rows = [own.as_dict() for own in self.experiments]
        own = {"hypotheses": list(self.hypotheses), "unknown": self.unknown}
        return plain(own | {"experiments": rows, "not_tried": self.not_tried})

    def __str__(self) -> str:
        bits = f"of {self.unknown:.2g} bits"
        lines = [*self.summary(), f"{'experiment':36s} {bits:>12s} {'evidence':>10s} {'seconds':>10s} {'load':>6s}"]
        for own in self.experiments:
            seconds = f"{own.seconds:10.3g}" if np.isfinite(own.seconds) else f"{'never':>10s}"
            row = f"{own.information:12.2g} {own.evidence:10.3g} {seconds} {own.load:6.2f}"
            lines.append(f"{own.change.what:36s} {row}")
        lines += [f"{what}: not tried, {why}" for what, why in self.not_tried.items()]
        return "\n".join(lines)


@with_one_blas_thread
def tell_apart(
    hypotheses: Mapping[str, Model],
    i_e: FloatArray,
    period: int,
    instruments: Instruments,
    *,
    more_instruments: Instruments | None = None,
    limits: Limits | None = None,
    probabilities: Mapping[str, float] | None = None,
) -> Proposals:
    """Predict which next experiment distinguishes hypotheses.

    Parameters
    ----------
    hypotheses : mapping of str to Model
        Two or more, each with its effect at the values that the present record asks for.
    i_e : ndarray, shape (N, axes)
        What was played.
    period : int
        Samples per period.
    instruments : Instruments
        Noise of the present record.
    more_instruments : Instruments, optional
        Noise with that of what was not recorded and could be, such as i_c or the flux density.
    limits : Limits, optional
        An experiment beyond them is not tried.
    probabilities : mapping of str to float, optional
        Of each hypothesis now, above zero, up to a factor; by default all are as likely.

    Returns
    -------
    Proposals
        Those that would do by their cost, then the others by the information that they bring.

    Raises
    ------
    InputError
        If there are fewer than two hypotheses, or periods, or one has no probability above zero.
    """
    if len(hypotheses) < 2:
        raise InputError(f"{len(hypotheses)} hypothesis: give two or more that are to be distinguished")
    limits = limits or Limits()
    rig = next(iter(hypotheses.values())).rig
    likely = _normalised(dict.fromkeys(hypotheses, 1.0) if probabilities is None else probabilities, hypotheses)
    found, not_tried = [], {}
    more = more_instruments or instruments
    new = [name for name in (*more.signals, *more.further) if name not in (*instruments.signals, *instruments.further)]
    for change in changes(rig, new):
        further = more.without(*(name for name in new if name not in change.record))
        try:
            load = max(forecast(change.at(own), i_e, period=period, limits=limits).load for own in hypotheses.values())
            if change.amplitude > 1.0:
                if load > 1.0 / LOUDER:
                    not_tried[change.what] = f"the largest peak is {load:.2g} times its limit already"
                    continue
                largest = min(change.amplitude, 1.0 / load)
                change = replace(change, what=f"{largest:.3g} times the amplitude", amplitude=largest)
            pairs = [
                _Pair(truth, other, change, i_e, period, (instruments, further))
                for truth, other in permutations(hypotheses.values(), 2)
            ]
            evidence, repeats = min(pair.once for pair in pairs), max(pair.repeats() for pair in pairs)
            information = gained(likely, np.array([pair.adds for pair in pairs]))
        except (UnstableLoopError, ModelError) as error:
            not_tried[change.what] = str(error)
            continue
        seconds = repeats * len(i_e) / rig.sample_rate
        # seconds that another operating point costs beside its record: the machine is stopped, set up and warmed again
        cost = seconds + (600.0 if change.rig is not None or change.record else 0.0)
        found.append(Proposal(change, evidence, information, repeats, seconds, load * change.amplitude, cost))
    found.sort(key=lambda own: (own.cost, -own.information))
    return Proposals(tuple(hypotheses), tuple(found), not_tried, gained(likely, np.inf))


def changes(rig: Rig, record: Iterable[str]) -> Iterator[Change]:
    """All experiments that may be tried next on a machine; `record` is what could be recorded and is not."""
    yield Change("the same once more")
    for channels in by_signal(record).values():
        yield Change(f"record {', '.join(channels)}", record=tuple(channels))
    for factor in (0.5, 2.0):
        yield Change(f"{factor:g} times the amplitude", amplitude=factor)
    for factor in (0.5, 1.5) if rig.speed > 0.0 else ():
        yield Change(f"speed {factor * rig.speed:.4g} rad/s", rig=rig.replace(speed=factor * rig.speed))
    # bias currents that are tried, over the present one: K_i follows it, and K_s its square
    for factor in (0.75, 1.25):
        with suppress(RigError):  # beyond what a rig file may hold
            bearings = tuple(
                bearing.model_copy(
                    update={
                        "bias_current": factor * bearing.bias_current,
                        "force_current": tuple(factor * value for value in bearing.force_current),
                        "force_displacement": tuple(factor**2 * value for value in bearing.force_displacement),
                    }
                )
                for bearing in rig.bearings
            )
            yield Change(f"{factor:g} times the bias current", rig=rig.replace(bearings=bearings))
    if isinstance(rig.controller, PidController):
        for key in ("proportional", "derivative"):
            for factor in (0.8, 1.25):
                gain = np.asarray(getattr(rig.controller, key)) * factor
                if gain.any():
                    gains = gain.tolist() if gain.ndim == 0 else tuple(gain.tolist())
                    other = rig.controller.model_copy(update={key: gains})
                    yield Change(f"{factor:g} times controller.{key}", rig=rig.replace(controller=other))


def _normalised(probabilities: Mapping[str, float], hypotheses: Mapping[str, Model]) -> FloatArray:
    own = {name: probabilities.get(name) for name in {**hypotheses, **probabilities}}
    for name, p in own.items():
        if name not in hypotheses or p is None or not 0.0 < p < np.inf:
            raise InputError(
                f"probabilities[{name!r}] = {p}: expected one above zero for each of {', '.join(hypotheses)}, "
                "and no other"
            )
    values = np.array([probabilities[name] for name in hypotheses])
    return values / values.sum()


def gained(probabilities: FloatArray, evidence: FloatArray | float) -> float:
    """Least expected information about which of n hypotheses is true [bits], see the module.

    Parameters
    ----------
    probabilities : ndarray, shape (n,)
        Before the record; their sum is one.
    evidence : ndarray, shape (n (n - 1),), or float
        lambda of the record against each other hypothesis where one is true, in the order of permutations.
    """
    n = len(probabilities)
    apart = np.zeros((n, n))
    apart[~np.eye(n, dtype=bool)] = evidence
    return float(-probabilities @ np.log2(np.exp(-apart / 8.0) @ probabilities))


def next_experiments(
    diagnosis: Diagnosis,
    *,
    current_noise: float = CURRENT_NOISE,
    further_noise: Mapping[str, float] | None = None,
    limits: Limits | None = None,
) -> Proposals:
    """Foresee which next experiment settles an ambiguous verdict.

    Parameters
    ----------
    diagnosis : Diagnosis
        Of records of which the first in time has periods and i_e.
    current_noise : float
        Rms that i_c would have [A], where it was not recorded and could be.
    further_noise : mapping of str to float, optional
        The same of further channels that could be recorded, such as ``b.A_zeta``, in their units.
    limits : Limits, optional

    Returns
    -------
    Proposals
        For the first of its sets, each member at the values that the records ask for, beside all else that was found.

    Raises
    ------
    InputError
        If the verdict is another, or there is no such record.
    """
    if diagnosis.verdict != "ambiguous" or diagnosis.fit is None:
        raise InputError(f"the verdict is {diagnosis.verdict}: only what is ambiguous can be distinguished")
    record = next((own for own in diagnosis.records if own.period is not None), None)
    if record is None or record.i_e is None or record.period is None:
        raise InputError("none of the records has periods and i_e; give what was played to tell_apart()")
    instruments = Instruments.of(diagnosis.fit)
    noise = {"i_c": current_noise, **(further_noise or {})}
    recorded = (*instruments.signals, *instruments.further)
    more = instruments.beside({name: rms for name, rms in noise.items() if name not in recorded})
    whole = record.periods * record.period
    i_e = record.i_e[:whole] - record.i_e[:whole].mean(axis=0)
    hypotheses = _members(diagnosis, diagnosis.fit)
    return tell_apart(
        hypotheses,
        i_e,
        record.period,
        instruments,
        more_instruments=more,
        limits=limits,
        probabilities=_likely(diagnosis, hypotheses),
    )


def _likely(diagnosis: Diagnosis, hypotheses: Mapping[str, Model]) -> dict[str, float]:
    """Probability of the model of a diagnosis, and of the same with another member in place of the one it has."""
    shared = frozenset(diagnosis.effects) - set(hypotheses)
    totals = {frozenset(own.effects): own.total for own in diagnosis.probabilities.sets}
    return {name: max(totals.get(shared | {name}, 0.0), NEGLIGIBLE) for name in hypotheses}


def _members(diagnosis: Diagnosis, fit: Comparison) -> dict[str, Model]:
    """The model of a diagnosis, and the same with each other member of its first set in place of the one it has."""
    names: Sequence[str] = diagnosis.ambiguous_sets[0]
    (present,) = (name for name in names if name in diagnosis.effects)
    found = {present: fit.model}
    rest = fit.model.without(present)
    for name in names:
        ranked = (step.ranking.find(name) for step in diagnosis.history)
        candidate = next((own for own in ranked if own is not None), None)
        if candidate is not None and name != present:
            with suppress(UnstableLoopError):
                found[name] = refit(fit.of(rest.add(candidate.effect, candidate.start)), step=ROUGHLY).model
    return found


class _Pair:
    """Evidence against one hypothesis if another is the truth, of the present record and a change of it."""

    def __init__(
        self, truth: Model, other: Model, change: Change, i_e: FloatArray, period: int, both: tuple[Instruments, ...]
    ) -> None:
        self.other, (self.present, self.further) = other, both
        following = planned(change.at(truth), change.amplitude * i_e, period, self.further)
        self.records = [planned(truth, i_e, period, self.present), replace(following, name="next")]
        self.once = self._evidence(1.0)
        self.adds = max(0.0, self.once - refit(foreseen(other, self.records[:1], (self.present,))).cost)

    def repeats(self) -> float:
        """So many times as long as the present one must the next record be; infinite where no length would do."""
        before, times, evidence = 0.0, 1.0, self.once
        collected = 0.0
        while evidence < NEARLY * DISTINCT:
            slope = (evidence - collected) / (times - before)
            # length of the next record over the present one that is not to be had: what needs more is rounding
            if slope * 1e4 < DISTINCT - evidence:
                return float("inf")
            before, collected = times, evidence
            times += (DISTINCT - evidence) / slope
            evidence = self._evidence(times)
        return times

    def _evidence(self, times: float) -> float:
        """What the other leaves of both records, the next so many times as long."""
        noise = (self.present, self.further.averaged(times))
        return refit(foreseen(self.other, self.records, noise)).cost
