"""The story of a diagnosis, chapter by chapter, as the template tells it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ambid.diagnosis import Diagnosis, Localisation, Ranking, Step, compare
from ambid.effects import Effect
from ambid.report import numbers, pictures, words
from ambid.rig import Rig

WORST = 6
RANKED = 10


def story(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything that the template needs; chapters that do not belong to the verdict are None or empty."""
    told = {
        "words": words,
        "diagnosis": diagnosis,
        "adequate": diagnosis.verdict == "adequate",
        "sentence": words.verdict_sentence(diagnosis, np.nan, np.nan, None),
        "notes": list(diagnosis.notes),
        "machine": numbers.rig_figures(diagnosis.model.rig, diagnosis.model.points),
        "figures": [],
        "choices": [],
        "invisible": [],
        "where": None,
        "rankings": [],
        "left": None,
        "ledger": None,
        "shape": None,
        "signals": [],
        "parameters": [],
    }
    return told if not diagnosis.history else told | _chapters(diagnosis)


def _chapters(diagnosis: Diagnosis) -> dict[str, Any]:
    first, last = diagnosis.history[0], numbers.last_step(diagnosis)
    validation = None
    if first.validation_misfit is not None and last.validation_misfit is not None:
        validation = (first.validation_misfit, last.validation_misfit)
    base = numbers.base_model(diagnosis)
    before = compare(base, diagnosis.records) if diagnosis.fit is None else diagnosis.fit.of(base)
    after = diagnosis.fit if last is not first else None
    errors = numbers.standard_errors(diagnosis)
    where, missing = diagnosis.localisation, diagnosis.verdict != "adequate"
    said = where.sentence() if where is not None and missing else ""
    known = {p.name: p.value for p in first.model.parameters}
    return {
        "sentence": words.verdict_sentence(diagnosis, first.misfit, last.misfit, validation),
        "notes": [note for note in diagnosis.notes if note != said],
        "figures": _figures(diagnosis, first, last),
        "choices": [_choices(names, diagnosis.history) for names in diagnosis.ambiguous_sets],
        "invisible": [] if missing else _invisible(first.ranking, base.rig),
        "where": None if where is None else _where(where, said, missing),
        "rankings": _rankings(diagnosis, last),
        "left": _left(last) if last is not first else None,
        "ledger": _ledger(diagnosis, errors) if len(diagnosis.history) > 1 else None,
        "shape": pictures.needed(where, diagnosis.model.rig.axes) if where is not None and missing else None,
        "signals": list(pictures.before_and_after(before, after)),
        "parameters": [(p, errors[p.name], known.get(p.name)) for p in diagnosis.model.parameters],
    }


def _figures(diagnosis: Diagnosis, first: Step, last: Step) -> list[dict[str, Any]]:
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
        fits = (first.validation_fit_percent["average"], last.validation_fit_percent["average"])
        misfits = (first.validation_misfit, last.validation_misfit)
        rows.append(
            {"name": "validation", "fit": fits, "ceiling": numbers.ceiling_of_y(diagnosis.kept_back), "misfit": misfits}
        )
    return rows


def _choices(names: list[str], history: Sequence[Step]) -> list[dict[str, Any]]:
    """What stands to choose from where effects cannot be told apart; values are those of the first ranking."""
    ranked: dict[str, Effect] = {c.effect.name: c.effect for step in history for c in step.ranking.candidates}
    first = history[0].ranking
    return [{"name": name, "physics": ranked[name].physics, "candidate": first.find(name)} for name in names]


def _invisible(ranking: Ranking, rig: Rig) -> list[tuple[str, list[str]]]:
    """The largest values that would stay invisible in these data, effect by effect."""
    found = []
    for c in ranking.candidates:
        units = {p.name: p.unit for p in c.effect.parameters(rig)}
        sizes = {name: value for name, value in c.smallest_visible.items() if np.isfinite(value)}
        if sizes:
            found.append((c.effect.name, [f"{n} {words.quantity(v, units[n], digits=2)}" for n, v in sizes.items()]))
    return found


def _where(where: Localisation, sentence: str, missing: bool) -> dict[str, Any]:
    """Map, worst cells and ports."""
    return {
        "pictures": list(pictures.maps(where)),
        "sentence": f"What is missing {sentence[3:]}"
        if sentence.startswith("it ")
        else sentence[:1].upper() + sentence[1:],
        "cells": where.cells[:WORST] if missing else (),
        "ports": where.ports if missing else (),
    }


def _rankings(diagnosis: Diagnosis, last: Step) -> list[dict[str, Any]]:
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
            "shown": ranking.candidates[:RANKED],
            "picture": pictures.ranking(ranking),
        }
        for ranking, added in pairs
    ]


def _left(last: Step) -> str:
    """What the candidates could still do after the last step."""
    significant = last.ranking.significant
    if not significant:
        return "After the last step no candidate is significant any more."
    best = max(significant, key=lambda c: c.score)
    return (
        f"After the last step {len(significant)} of {len(last.ranking.candidates)} candidates still stand beyond "
        f"chance, but would do little: the best of them, {words.plain(best.effect.name)}, promises to take the misfit "
        f"from {words.misfit(last.misfit)} to {words.misfit(best.predicted_misfit)}; it was not added."
    )


def _ledger(diagnosis: Diagnosis, errors: dict[str, float]) -> dict[str, Any]:
    return {
        "steps": diagnosis.history,
        "picture": pictures.staircase(diagnosis),
        "moved": numbers.moved(diagnosis, errors)[:WORST],
        "led_nowhere": numbers.last_step(diagnosis) is not diagnosis.history[-1],
    }
