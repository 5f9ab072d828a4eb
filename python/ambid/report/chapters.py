"""The story of a diagnosis, chapter by chapter, as the page shows it."""

from collections.abc import Hashable, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

import numpy as np
from markupsafe import Markup

from ambid.diagnosis import Comparison, Diagnosis, Localisation, MisfitMatrix, Ranking, Step, compare, misfit_matrix
from ambid.diagnosis.moves import Moved, moved
from ambid.effects import Effect
from ambid.errors import AmbidError, RecordError
from ambid.findings import worst_first
from ambid.identification.tolerances import NOISE, percent, shares
from ambid.model import Model
from ambid.model.parameter import nominal
from ambid.report import numbers, pictures, words
from ambid.rig import Rig
from ambid.robustness import Margin, Margins, margins, pole_map
from ambid.robustness.result import tolerated

DRAWS = 200
"""Of the parameters: they give a probability to 4 % (one standard error), in less time than a diagnosis takes."""


def story(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that the page needs; chapters that do not belong to the verdict are None or empty."""
    opening = {
        "words": words,
        "worst_first": worst_first,
        "figures": Numbering("Figure"),
        "tables": Numbering("Table"),
        "title": f"Diagnosis of {diagnosis.model.rig.name}",
        "version": version("ambid"),
        "written": words.date(datetime.now().astimezone()),
        "diagnosis": diagnosis,
        "adequate": diagnosis.verdict == "adequate",
        "verdict": words.verdict_sentence(diagnosis, np.nan, np.nan, None),
        "chances": [],
        "findings": diagnosis.findings,
        "machine": numbers.rig_figures(diagnosis.model.rig, diagnosis.model.points),
        "records": [
            *(("diagnosis", record) for record in diagnosis.records),
            *(("validation", record) for record in diagnosis.validation),
        ],
        "of_records": [
            finding.at(record=record.name)
            for record in (*diagnosis.records, *diagnosis.validation)
            for finding in record.findings
        ],
        "files": numbers.files_of(diagnosis),
        "is_moved": False,
        "fits": [],
        "choices": [],
        "invisible": [],
        "shown": [],
        "drawn": pictures.DRAWN,
        "where": None,
        "rankings": [],
        "ledger": None,
        "parameters": [],
        "tolerances": [],
        "budget": None,
        "left": None,
        "standing": None,
    }
    return opening if not diagnosis.history else opening | _chapters(diagnosis)


def _chapters(diagnosis: Diagnosis) -> dict[str, Any]:
    first, last = diagnosis.history[0], numbers.last_step(diagnosis)
    validation = None
    if first.validation_misfit is not None and last.validation_misfit is not None:
        validation = (first.validation_misfit, last.validation_misfit)
    base, is_moved = numbers.base_model(diagnosis), last is not first
    before = compare(base, diagnosis.records) if diagnosis.fit is None else diagnosis.fit.of(base)
    where, missing = diagnosis.localisation, diagnosis.verdict != "adequate"
    located = where.findings if where is not None and missing else ()
    changes = moved(first.model, diagnosis.model, numbers.standard_errors(diagnosis)) if is_moved else ()
    return {
        "is_moved": is_moved,
        "verdict": words.verdict_sentence(diagnosis, first.misfit, last.misfit, validation),
        "chances": [(words.plain(name), share) for name, share in diagnosis.probabilities.listed.items()],
        "findings": [finding for finding in diagnosis.findings if finding not in located],
        "fits": _fits(diagnosis, first, last),
        "choices": [_choices(names, diagnosis.history, base.rig) for names in diagnosis.ambiguous_sets],
        "invisible": [] if missing else _invisible(first.ranking, base.rig),
        "shown": pictures.before_and_after(diagnosis, before, is_moved),
        "where": None if where is None else _where(diagnosis, where, before, missing),
        "rankings": _rankings(diagnosis, last, base.rig),
        "ledger": None
        if len(diagnosis.history) == 1
        else {"picture": pictures.staircase(diagnosis), "led_nowhere": last is not diagnosis.history[-1]},
        "parameters": _parameters(diagnosis, first, changes),
        "tolerances": [(name, *own.texts()) for name, own in diagnosis.tolerances.items()],
        "budget": _budget(diagnosis) if diagnosis.tolerances else None,
        "most_moved": words.most_moved(changes[:3]),
        "left": _left(diagnosis, last) if is_moved else None,
        "standing": _standing(diagnosis.model, base if is_moved else None),
    }


def _fits(diagnosis: Diagnosis, first: Step, last: Step) -> list[dict[str, Any]]:
    """Fit, ceiling and misfit, before and after, of the records and of those for validation."""
    rows = [
        {
            "name": ", ".join(record.name for record in diagnosis.records),
            "fit": (first.fit_percent["average"], last.fit_percent["average"]),
            "ceiling": numbers.ceiling_of_y(diagnosis.fit),
            "misfit": (first.misfit, last.misfit),
        }
    ]
    if first.validation_fit_percent is not None and last.validation_fit_percent is not None:
        names = ", ".join(record.name for record in diagnosis.validation)
        fits = (first.validation_fit_percent["average"], last.validation_fit_percent["average"])
        misfits = (first.validation_misfit, last.validation_misfit)
        ceiling = numbers.ceiling_of_y(diagnosis.kept_back)
        rows.append({"name": f"{names}, for validation", "fit": fits, "ceiling": ceiling, "misfit": misfits})
    return rows


def _choices(names: list[str], history: Sequence[Step], rig: Rig) -> list[dict[str, Any]]:
    """The choices where effects cannot be distinguished; values are those of the first ranking."""
    ranked: dict[str, Effect] = {c.effect.name: c.effect for step in history for c in step.ranking.candidates}
    first, found = history[0].ranking, []
    for name in names:
        candidate = first.find(name)
        values = "" if candidate is None else words.values(candidate.start, numbers.units(candidate.effect, rig))
        found.append({"name": name, "physics": ranked[name].physics, "candidate": candidate, "values": values})
    return found


def _invisible(ranking: Ranking, rig: Rig) -> list[tuple[str, list[str]]]:
    """The largest values that would stay invisible in these data, effect by effect."""
    found = []
    for c in ranking.candidates:
        units = numbers.units(c.effect, rig)
        sizes = {name: value for name, value in c.smallest_visible.items() if np.isfinite(value)}
        if sizes:
            found.append((c.effect.name, [f"{n} {words.quantity(v, units[n], digits=2)}" for n, v in sizes.items()]))
    return found


def _where(diagnosis: Diagnosis, where: Localisation, before: Comparison, missing: bool) -> dict[str, Any]:
    """Map, worst cells, matrix, ports and shape."""
    matrix = _matrix(before, where.maps[where.worst].record) if missing else None
    return {
        "pictures": list(pictures.maps(where.maps, "base")),
        "growth": pictures.growth(where),
        "findings": where.findings if missing else (),
        "cells": where.cells[:6] if missing else (),
        "matrix": None if matrix is None else pictures.matrix(matrix),
        "crossed": [] if matrix is None else matrix.lines(most=0),
        "ports": where.ports if missing else (),
        "shape": pictures.needed(where, diagnosis.model.rig.axes) if missing else None,
    }


def _matrix(before: Comparison, record: str) -> MisfitMatrix | None:
    """Of the record that is missed most; None where its noise is not known, or nothing drives it."""
    try:
        found = misfit_matrix(before)
    except RecordError:
        return None
    return next((own for own in found if own.record == record), None)


def _rankings(diagnosis: Diagnosis, last: Step, rig: Rig) -> list[dict[str, Any]]:
    """The ranking before each step that the last model holds; the first one where nothing was added."""
    steps = diagnosis.history
    used = [(step, then) for step, then in zip(steps, steps[1:], strict=False) if then.predicted_misfit is not None]
    used = used[: steps.index(last)] if last is not steps[0] else []
    pairs: list[tuple[Ranking, str | None]] = [(step.ranking, then.added) for step, then in used]
    pairs = pairs or [(steps[0].ranking, None)]
    return [
        {
            "ranking": ranking,
            "added": added,
            "candidate": ranking.find(added) if added is not None else None,
            "shown": [(c, words.values(c.start, numbers.units(c.effect, rig))) for c in ranking.candidates[:10]],
            "picture": pictures.ranking(ranking),
        }
        for ranking, added in pairs
    ]


def _parameters(diagnosis: Diagnosis, first: Step, changes: Sequence[Moved]) -> list[words.Row]:
    """Every parameter of the last model, then settings of its effects: rig file, before, now, interval, move."""
    of_rig = {p.name: p.value for p in nominal(diagnosis.model.rig)}
    before = {p.name: p.value for p in first.model.parameters}
    by_name = {own.name: own for own in changes}
    settings = [own for effect in diagnosis.model.effects for own in effect.fine_settings().items()]
    rows = [
        words.Row.of(p.name, diagnosis.parameters[p.name], of_rig.get(p.name), before.get(p.name), by_name.get(p.name))
        for p in diagnosis.model.parameters
        if p.prior is None
    ]
    return [*rows, *(words.Row.of_setting(name, *own) for name, own in settings)]


def _budget(diagnosis: Diagnosis) -> dict[str, Any]:
    """What makes the variance of each parameter [%]: noise, and every tolerance that makes much of one of them."""
    parts = {name: dict(shares(own)) for name, own in diagnosis.budget().items()}
    much = [name for name in diagnosis.tolerances if any(own[name] >= 0.02 for own in parts.values())]
    rows = {source: [own[source] for own in parts.values()] for source in (NOISE, *much)}
    rest = [max(0.0, 1.0 - sum(own)) for own in zip(*rows.values(), strict=True)]
    shown = rows | {"all others": rest}
    return {"parameters": list(parts), "rows": {source: list(map(percent, own)) for source, own in shown.items()}}


def _left(diagnosis: Diagnosis, last: Step) -> dict[str, Any]:
    """The map of the last model, and what the candidates could still do."""
    return {
        "sentence": words.left_sentence(diagnosis),
        "pictures": list(pictures.maps(diagnosis.left, "last", like=diagnosis.localisation)),
        "candidates": _candidates_left(last),
    }


def _candidates_left(last: Step) -> str:
    significant = last.ranking.significant
    if not significant:
        return "After the last step no candidate is significant any more."
    best = max(significant, key=lambda c: c.score)
    return (
        f"After the last step {len(significant)} of {len(last.ranking.candidates)} candidates still stand beyond "
        f"chance, but would do little: the best of them, {words.plain(best.effect.name)}, promises to take the misfit "
        f"from {words.misfit(last.misfit)} to {words.misfit(best.predicted_misfit)}; it was not added."
    )


def _standing(model: Model, base: Model | None) -> dict[str, Any]:
    """Margins of a model with their zones, and its poles beside those of the base model."""
    try:
        found = margins(model, draws=DRAWS)
    except AmbidError as error:  # unstable at its values, or a covariance that determines nothing
        return {"why_not": str(error)}
    rows = [
        _margin(own.axis, own.sensitivity, own.disk, own.zone, own.zone_probability.get(own.zone)) for own in found.axes
    ]
    rows.append(_margin("all at once", found.multivariable, found.disk, "", None))
    return {
        "why_not": "",
        "sentence": _margin_sentence(found),
        "rows": rows,
        "findings": found.findings,
        "picture": pictures.sensitivity(found),
        "poles": pictures.poles(pole_map(model), None if base is None else pole_map(base)),
    }


def _margin(axis: str, peak: Margin, disk: Margin, zone: str, probability: float | None) -> dict[str, Any]:
    span = "–" if peak.ci95 is None else " to ".join(map(words.peak, peak.ci95))
    texts = (words.peak(peak.value), words.decibel(peak.value), words.number(peak.frequency_hz, 4), span)
    return {
        "axis": axis,
        "numbers": (*texts, "–" if peak.worst is None else words.peak(peak.worst)),
        "zone": zone,
        "probability": "" if not zone else "–" if probability is None else f"{100.0 * probability:.3g} %",
        "disk": f"{disk.value:.3f}",
    }


def _margin_sentence(found: Margins) -> str:
    """Zone with its probability, and what the disk margin allows."""
    worst = max(found.axes, key=lambda own: own.sensitivity.value)
    text = (
        f"The loop is in zone {found.zone} of ISO 14839-3, by the peak of {words.peak(worst.sensitivity.value)} "
        f"({words.decibel(worst.sensitivity.value)} dB) in {worst.axis}"
    )
    if found.zone_probability:
        shares = ", ".join(f"{zone} {100.0 * share:.3g} %" for zone, share in found.zone_probability.items())
        text += f"; by {found.draws} draws of the parameters the zones are as probable as {shares}"
    low, high, phase = tolerated(found.disk.value)
    most = f"{high:.3g}" if np.isfinite(high) else "any"
    return (
        f"{text}. All axes at once tolerate gain factors from {low:.3g} to {most}, or {phase:.3g}° of phase (disk "
        f"margin {found.disk.value:.3g})."
    )


class Numbering:
    """Numbers of one kind, such as figures; what the text does not speak of has none, and cannot be shown.

    Parameters
    ----------
    word : str
        Such as ``Figure``.
    """

    def __init__(self, word: str) -> None:
        self.word = word
        self._known: dict[Hashable, int] = {}

    def see(self, key: Hashable) -> Markup:
        """A link to it, such as ``Figure 3``, for the text."""
        number = self._known.setdefault(key, len(self._known) + 1)
        return Markup('<a href="#{}">{}&nbsp;{}</a>').format(self.anchor(key), self.word, number)

    def label(self, key: Hashable) -> str:
        """Its name, such as ``Figure 3``, for the caption."""
        return f"{self.word} {self._known[key]}"

    def anchor(self, key: Hashable) -> str:
        """Where its links lead."""
        return f"{self.word.lower()}-{self._known[key]}"
