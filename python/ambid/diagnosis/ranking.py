"""Which effect does the residual ask for: every candidate's score before any of them is refitted.

A candidate's response change psi, whitened, is freed from what refitting the known parameters absorbs,
``psi~ = (I - P_Psi) psi``. The residual e, freed alike, then calls for ``a = argmin |e - psi~ a|`` of it, and

    S = |e|^2 - |e - psi~ a|^2

over the spread that the noise spectrum's own uncertainty gives it is chi-squared with as many degrees of freedom as
psi has columns where the candidate is absent (Rao's score test; modification index of structural-equation software).
Values that physics forbids are not taken: a column of one sign counts as half a degree of freedom, by the weights of
Self and Liang, J. Am. Stat. Assoc. 82 (1987) 605, case 9.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import lsq_linear
from scipy.special import chdtri

from ambid.arrays import FloatArray
from ambid.diagnosis.candidates import Candidate, Ranking
from ambid.diagnosis.nameless import Ways
from ambid.effects import CATALOGUE, Effect, Seen
from ambid.errors import ModelError, UnstableLoopError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification.minimum import SUBSTEPS
from ambid.model import Model
from ambid.model.structure import is_nonlinear
from ambid.noise import Comparison
from ambid.noise.chance import independent_tests, log_chance_bounded
from ambid.rig import Rig
from ambid.threads import with_one_blas_thread

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is, 0 where nobody knows."""
VISIBLE = 1e-4
"""Chance of a score that counts as visible, for one degree of freedom."""
OWN = 1e-12
"""Part of the largest eigenvalue of probes' Gram matrix below which a direction is that of other probes."""
ROUNDING = 1e-9
"""Part of a response, and of noise, that counts as nothing once it is freed from what known parameters absorb."""
NOT_APPLICABLE = Kind("effect_not_applicable", "note", "{reason}")
"""With the words of the effect itself, which may be a person's own, or of what could not be computed."""
KNOWN_COMMAND = Kind(
    "effect_within_command",
    "note",
    "i_e comes from the recorded command, and holds whatever the controller's gains miss",
)
UNDRIVEN = Kind(
    "effect_not_driven",
    "note",
    "nothing drives the records, and what an effect changes of a free response cannot be separated from how it began",
)
NOT_IN_RESPONSES = Kind(
    "effect_not_in_responses",
    "note",
    "a frequency response holds nothing of a disturbance, which follows no excitation; record in time",
)
SMALL_MOTION = Kind(
    "effect_of_large_motion",
    "note",
    "a frequency response is of small motion, where it is judged as absent; record in time, at two amplitudes",
)
NEAR = 0.5
"""Part of the best score from which on a refit may find another variant of an effect better: scores can err by that."""
SMALLER = (1.0, 0.1, 0.01)
"""Parts of a probe: a smaller one where the loop is so near the edge of stability that it makes none."""
CONFUSABLE = 0.9
"""Two candidates whose freed responses have a larger cosine are called confusable."""


def silent(what: str, done: int, total: int) -> None:
    """Tell nobody."""


@with_one_blas_thread
def rank(
    comparison: Comparison,
    catalogue: Sequence[Effect] = CATALOGUE,
    *,
    start: Model | None = None,
    progress: Progress = silent,
) -> Ranking:
    """Score every effect of a catalogue that the model does not have yet.

    Parameters
    ----------
    comparison : Comparison
        Of a fitted model with its records.
    catalogue : sequence of Effect
        Effects of your own may be among them.
    start : Model, optional
        The same model at other values, where effects are judged that make no stable loop near the fit.
    progress : callable
        Told what is being done, how much of it is done, and how much there is.

    Returns
    -------
    Ranking
    """
    model = comparison.model
    here = Point(comparison)
    elsewhere: Point | None = None
    seen = see(comparison)

    candidates: list[Candidate] = []
    bases: dict[str, FloatArray] = {}
    not_tried: list[Finding] = []
    present = {effect.name for effect in model.effects}
    for done, effect in enumerate(catalogue):
        progress("ranking", done, len(catalogue))
        if effect.name in present:
            continue
        home = model.home_of(effect)
        if home is None:
            not_tried.append(NOT_APPLICABLE(NOWHERE, effect=effect.name, reason=effect.why_not(model.rig)))
            continue
        if (kind := _not_shown(comparison, effect, home)) is not None:
            not_tried.append(kind(NOWHERE, effect=effect.name))
            continue
        variants = effect.variants(replace(seen, rig=home))
        best, basis, why = _best(here, variants, here.cost)
        if variants and best is None and start is not None and start.may_stand:
            elsewhere = elsewhere or Point(comparison.of(start))
            found, basis, _ = _best(elsewhere, variants, here.cost)
            best = None if found is None else replace(found, from_start=True)
        if best is None:
            not_tried.append(NOT_APPLICABLE(NOWHERE, effect=effect.name, reason=why or effect.unseen))
        else:
            candidates.append(best)
            bases[effect.name] = basis / np.sqrt(max(1, len(basis)))
    candidates.sort(key=lambda candidate: candidate.chance)
    directions = np.array([candidate.direction for candidate in candidates])
    cosines = np.abs(directions @ directions.T) if candidates else np.zeros((0, 0))
    ranked = []
    for k, candidate in enumerate(candidates):
        near = [c.effect.name for j, c in enumerate(candidates) if j != k and cosines[k, j] > CONFUSABLE]
        ranked.append(replace(candidate, confusable_with=tuple(near)))
    ways = Ways()
    if bases:
        whose = tuple(name for name, own in bases.items() for _ in own)
        ways = Ways(np.concatenate(list(bases.values())), whose, here.spreads)
    return Ranking(tuple(ranked), comparison.misfit, tuple(not_tried), comparison, ways)


def _not_shown(comparison: Comparison, effect: Effect, home: Rig) -> Kind | None:
    """Why these records cannot show an effect, whatever they hold; None where they can."""
    records = comparison.noise.records
    in_time = [part.record for part in comparison.noise.in_time]
    if all(record.is_free_response for record in records):
        return UNDRIVEN
    if not in_time and effect.waveform(home, 1, None).shape[1]:
        return NOT_IN_RESPONSES
    if not in_time and is_nonlinear(home, effect):
        return SMALL_MOTION
    if effect.within_command and in_time and all(record.has_known_command for record in in_time):
        return KNOWN_COMMAND
    return None


def see(comparison: Comparison) -> Seen:
    """What effects may look at before they are tried."""
    model, noise = comparison.model, comparison.noise
    has_amplifier = model.rig.amplifier.time_constant > 0.0
    has_rate = has_amplifier or model.rig.actuator.has_lag
    watched = ["s", "i_f", "i_ref"] + ["i_f_rate"] * has_rate + ["i_a_free"] * has_amplifier
    peaks = dict.fromkeys(watched, 0.0)
    n = len(model.rig.axes)
    records = [part.record for part in noise.in_time]
    for record in records:
        here = model.at(record)
        found = np.abs(here.watching(watched).simulate(here.theta, here.excitation(record))).max(axis=0)
        found = found[-len(watched) * n :]
        for k, name in enumerate(watched):
            peaks[name] = max(peaks[name], float(found[k * n : (k + 1) * n].max()))
    tones = {round(tone.frequency_hz, 3): tone for own in noise.tones for tone in own}
    across = any(effect.across_planes for effect in model.effects)
    return Seen(model.rig, peaks, tuple(tones.values()), comparison.held, model.points, across)


class Point:
    """A model at which effects are judged, with its residual freed from what its parameters absorb.

    Where more than noise is left, errors of the rig file absorb no more of it than they do in the fit, see
    `noise.known`: what is known of them beforehand counts V times.

    The change that a linear effect makes to a nonlinear loop is taken from the loop without its nonlinear effects: it
    ranks as well, a hundred times as fast, and the refit is exact.

    Attributes
    ----------
    at_edge : set of str
        Effects of which a probe made no stable loop.
    """

    def __init__(self, comparison: Comparison) -> None:
        model, self.noise = comparison.model, comparison.noise
        every = list(range(len(model.names)))
        self.transients = self.noise.transients(model)
        if model.is_linear:
            # of the settled response, as changes by effects are: of what an error of the rig file does too none is left
            residual, known = self.noise.residual(model), self.noise.slopes(model, every)
        else:
            residual, known = self.noise.jacobian(model, every, roughly=True)
        measured = len(self.noise.spreads)
        self.known = float(np.sqrt(self.noise.size.variance(float(np.sum(residual[:measured] ** 2)))))
        residual[measured:] *= self.known
        known[measured:] *= self.known
        known = self.noise.freed(known, self.transients)
        self.spreads = np.append(self.noise.spreads, np.ones(len(known) - measured))
        self.basis, _ = np.linalg.qr(known / _nonzero(np.linalg.norm(known, axis=0)))
        self.residual = self.freed(residual[None])[0]
        self.cost = float(self.residual @ self.residual)
        self.dof = comparison.dof
        self.exact = model if model.is_linear else model.with_substeps(SUBSTEPS)
        self.linear = model.without_nonlinear()
        if not self.linear.is_stable:
            self.linear = self.exact
        self.at_edge: set[str] = set()
        self._before: dict[int, FloatArray] = {}

    def freed(self, rows: FloatArray) -> FloatArray:
        """What neither the transients nor the known parameters can absorb of whitened rows, which it overwrites."""
        for own, basis in zip(self.noise.by_record(rows.T), self.transients, strict=True):
            part = own.T
            part -= (part @ basis) @ basis.T
        rows -= (rows @ self.basis) @ self.basis.T
        return rows

    def responses(self, effect: Effect) -> FloatArray:
        """Whitened change of the response by each probe of an effect, shape (probes, numbers).

        Of a linear effect whose probes move a parameter each, it is the derivative where the effect is absent. One that
        makes no stable loop is probed smaller: with other values of the known parameters there may be one.
        """
        home = self.exact.home_of(effect) or self.exact.rig
        probes = effect.probes(home)
        if is_nonlinear(home, effect):
            tried = [self.exact.add(effect, probe).with_substeps(SUBSTEPS) for probe in probes]
            return np.array([self.noise.departure(model) - self._departure(self.exact) for model in tried])
        moved = [[name for name, value in probe.items() if value] for probe in probes]
        if len(probes) > 1 and self.linear.is_linear and all(len(names) == 1 for names in moved):
            with suppress(ModelError):  # a parameter that stands in a denominator
                absent = self.linear.add(effect, dict.fromkeys(probes[0], 0.0))
                free = [absent.names.index(effect.slot(name)) for (name,) in moved]
                sizes = [probe[name] for probe, (name,) in zip(probes, moved, strict=True)]
                return np.asarray((self.noise.slopes(absent, free) * sizes).T)
        for part in SMALLER[: 1 if len(probes) > 1 else None]:
            own = probes if part == 1.0 else [effect.start(home, [part])]
            try:
                tried = [self.linear.add(effect, probe) for probe in own]
                return np.array([self.noise.departure(model) - self._departure(self.linear) for model in tried]) / part
            except UnstableLoopError as error:
                why = error
                self.at_edge.add(effect.name)
        raise why

    def _departure(self, base: Model) -> FloatArray:
        if id(base) not in self._before:
            self._before[id(base)] = self.noise.departure(base)
        return self._before[id(base)]


def _best(point: Point, variants: Sequence[Effect], cost: float) -> tuple[Candidate | None, FloatArray, str]:
    """The best variant of an effect at a point with what it can do, or why none can be judged.

    Scores are falls from `cost`; what it can do is an orthonormal basis of the changes of the response.
    """
    tried, changes, why = [], [], ""
    for variant in variants:
        try:
            changes.append(point.responses(variant))
            tried.append(variant)
        except (UnstableLoopError, ModelError) as error:
            why = str(error)
    if not tried:
        return None, np.zeros((0, 1)), why
    ends = np.cumsum([len(own) for own in changes])
    rows = np.concatenate(changes)
    changes.clear()
    least = ROUNDING * np.maximum(1.0, np.linalg.norm(rows, axis=1))
    rows = point.freed(rows)
    size = np.linalg.norm(rows, axis=1)
    rows[size <= least], size[size <= least] = 0.0, 0.0
    rows /= _nonzero(size)[:, None]
    gram, called_for = rows @ rows.T, rows @ point.residual
    calls = []
    for variant, first, end in zip(tried, [0, *ends], ends, strict=False):
        own = slice(first, end)
        calls.append(_Call(point, variant, _Subspace(rows[own], size[own], gram[own, own], called_for[own]), cost))
    independent = 1.0
    if len(calls) > 1 and gram.any():  # else no variant is felt at all
        turned = block_diag(*[call.of.turned for call in calls])
        independent = independent_tests(turned.T @ gram @ turned, len(calls))
    best, *others = sorted(calls, key=lambda call: call.chance(independent))
    linear = [c for c in others if best.fall > 0.0 and c.fall > NEAR * best.fall and not is_nonlinear(c.rig, c.effect)]
    of_kind = {c.parameters: c for c in reversed([best, *linear])}
    # other parameters are another law; else it is a place, or a size that was probed
    linear.sort(key=lambda c: of_kind[c.parameters] is not c)
    near = tuple((c.effect, c.predicted, c.fall / best.fall) for c in linear[:2])
    basis = best.of.turned.T @ best.of.rows
    return replace(best.candidate(independent), near=near), basis, why


def _nonzero(size: FloatArray) -> FloatArray:
    return np.where(size > 0.0, size, 1.0)


class _Subspace:
    """What an effect can add to the residual: freed responses of norm one, and an orthonormal basis of them.

    Attributes
    ----------
    rows : ndarray, shape (probes, numbers)
    size : ndarray, shape (probes,)
        Norms that they had.
    turned : ndarray, shape (probes, degrees)
        Its transpose times the rows is the basis.
    triangle : ndarray, shape (degrees, probes)
        Its transpose times the basis are the rows.
    called_for : ndarray, shape (degrees,)
        The residual in the basis.
    """

    def __init__(self, rows: FloatArray, size: FloatArray, gram: FloatArray, called_for: FloatArray) -> None:
        self.rows, self.size = rows, size
        values, vectors = np.linalg.eigh(gram)
        kept = values > OWN * values[-1]
        roots, vectors = np.sqrt(values[kept]), vectors[:, kept]
        self.turned, self.triangle = vectors / roots, roots[:, None] * vectors.T
        self.called_for = self.turned.T @ called_for


class _Call:
    """How much of an effect the residual calls for."""

    def __init__(self, point: Point, effect: Effect, of: _Subspace, cost: float) -> None:
        self.point, self.effect, self.of, self.cost = point, effect, of, cost
        self.rig = point.exact.home_of(effect) or point.exact.rig
        low, high = effect.amplitudes(self.rig)
        seen, free = _nonzero(of.size), of.turned @ of.called_for
        if len(free) == 1:
            free = np.clip(free, low * seen, high * seen)
        elif not ((low * seen <= free) & (free <= high * seen)).all():
            free = lsq_linear(of.triangle, of.called_for, bounds=(low * seen, high * seen), method="bvls").x
        left = of.called_for - of.triangle @ free
        fall = float(of.called_for @ of.called_for - left @ left)
        self.free, self.fall = free, max(0.0, fall - max(point.cost - cost, 0.0))
        self.degrees, self.one_sided = max(1, len(of.called_for)), int(np.sum(low == 0.0))
        basis = of.turned.T @ of.rows
        self.spread = float(np.sum(basis**2 @ point.spreads)) / self.degrees if basis.size else 1.0

    def chance(self, variants: float) -> float:
        """Logarithm of the chance of such a score, whichever of so many independent variants is best."""
        own = log_chance_bounded(self.fall / self.spread, self.degrees, self.one_sided)
        return min(0.0, own + float(np.log(variants)))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(own.name for own in self.effect.parameters(self.rig))

    @property
    def predicted(self) -> dict[str, float]:
        """Values of the parameters that the residual calls for; of one probe so much of it that a loop stands."""
        wanted = self.free / _nonzero(self.of.size)
        starts = [self.effect.start(self.rig, (part * wanted).tolist()) for part in SMALLER]
        if self.effect.name not in self.point.at_edge:
            return starts[0]
        return next((own for own in starts if self.point.linear.add(self.effect, own).is_stable), starts[0])

    def candidate(self, variants: float) -> Candidate:
        """The effect with its score."""
        direction = self.free @ self.of.rows
        norm = float(np.linalg.norm(direction))
        return Candidate(
            effect=self.effect,
            score=self.fall,
            degrees=self.degrees,
            start=self.predicted,
            predicted_misfit=(self.cost - self.fall) / (self.point.dof - self.degrees),
            smallest_visible=_smallest_visible(self.effect.probes(self.rig), self.of.size),
            direction=direction / norm if norm > 0.0 else direction,
            size=norm,
            residual=self.point.residual,
            spread=self.spread,
            one_sided=self.one_sided,
            variants=variants,
        )


def _smallest_visible(probes: Sequence[Mapping[str, float]], sizes: FloatArray) -> dict[str, float]:
    """Value of each parameter at which its score would just count, where each probe moves one parameter."""
    least = np.sqrt(chdtri(1, VISIBLE))
    found = {}
    for probe, size in zip(probes, sizes.tolist(), strict=True):
        moved = [name for name, value in probe.items() if value != 0.0]
        if len(moved) != 1:
            return {}
        if size > 0.0:
            found[moved[0]] = float(least / size * abs(probe[moved[0]]))
    return found
