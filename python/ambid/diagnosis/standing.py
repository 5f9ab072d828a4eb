"""Where the base model is unstable: which effects make it stand, as what is missing makes the machine stand.

Back-EMF damps a levitator, a bending mode lies elsewhere, a seal carries. Such a machine has no base model to begin
with; what makes one stand is fitted instead, and evidence decides among these sets.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ambid.checking.nominal import NominalLoop
from ambid.effects import CATALOGUE, Effect, Seen
from ambid.errors import AmbidError, ModelError, UnstableLoopError
from ambid.findings import NOWHERE, Finding, Kind
from ambid.identification import identify
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.model import Model
from ambid.model.structure import is_nonlinear
from ambid.noise import Comparison
from ambid.record import Measurement
from ambid.rig import Rig

BASE_UNSTABLE = Kind(
    "base_unstable",
    "warning",
    "the base model is unstable: a pole at {frequency_hz:.3g} Hz grows with {growth_per_s:.3g} 1/s, and moves mostly "
    "the rotor's {mode} mode; with {effects} in the model it is stable, and evidence decides among these",
    "check the controller, K_i and K_s in the rig file, if none of these is likely",
)
NOTHING_HOLDS = Kind(
    "base_unstable_with_every_effect",
    "error",
    "the base model is unstable: a pole at {frequency_hz:.3g} Hz grows with {growth_per_s:.3g} 1/s, and moves mostly "
    "the rotor's {mode} mode; no effect that these records can show makes it stable[; K_i x {force_current_factor:.3g} "
    "would][; K_s x {force_displacement_factor:.3g} would]",
    "check the controller's sign (i_ref = -(K y) + i_e), gains and delay, and the sizes of K_i and K_s",
)
CHOICE_UNSTABLE = Kind(
    "base_unstable_with_chosen_effects",
    "error",
    "the base model is unstable, and stays so with {chosen}: a pole at {frequency_hz:.3g} Hz grows with "
    "{growth_per_s:.3g} 1/s, and moves mostly the rotor's {mode} mode[; with {effects} it is stable]",
    "choose one of these as the first effect; if there is none, check the controller, K_i and K_s in the rig file",
)
MULTIPLES = tuple(sign * factor for sign in (1.0, -1.0) for factor in (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3))
"""Of an effect's probes, at which it is asked whether the loop is stable."""
MOST_VARIANTS = 12
"""Of an effect, such as places, that are asked."""
FACTORS = np.geomspace(0.05, 20.0, 61)
"""Of all K_i, or all K_s, of which the nearest to 1 that would make the loop stable is stated."""


def standing(start: Model, records: Sequence[Measurement], effects: Sequence[Effect]) -> list[Comparison]:
    """Fits of the base model with each effect that makes it stable, all in the noise that the best leaves, best first.

    Parameters
    ----------
    start : Model
        Whose loop is unstable.
    records : sequence of Measurement
    effects : sequence of Effect
        To be tried.
    """
    fits = []
    for model in _held(start, records, effects):
        try:
            fits.append(identify(model, records).comparison)
        except AmbidError:
            continue  # stable where it starts, and no fit from there
    fits = sorted((fit for fit in fits if fit.is_judged), key=lambda fit: fit.misfit)
    found = fits[:1]
    for fit in fits[1:]:
        try:
            found.append(refit(fits[0].of(fit.model), step=ROUGHLY))
        except UnstableLoopError:
            continue
    return found


def base_unstable(start: Model, fits: Sequence[Comparison]) -> Finding:
    """That effects make a loop stable, by the fits of `standing`."""
    effects = [effect.name for fit in fits for effect in fit.model.effects if effect not in start.effects]
    return BASE_UNSTABLE(NOWHERE, **_pole(start), effects=effects)


def holders(start: Model, effects: Sequence[Effect] = CATALOGUE, records: Sequence[Measurement] = ()) -> list[str]:
    """Names of the effects, each of which makes an unstable loop stable at some of its values."""
    own = {effect.name for effect in start.effects}
    return [model.effects[-1].name for model in _held(start, records, [e for e in effects if e.name not in own])]


def choice_unstable(start: Model, chosen: Sequence[Effect], others: Sequence[str]) -> Finding:
    """That none of a person's own choice makes a loop stable, and what does."""
    return CHOICE_UNSTABLE(
        NOWHERE, **_pole(start), chosen=[effect.name for effect in chosen], effects=list(others) or None
    )


def nothing_holds(start: Model) -> Finding:
    """That none does, and what would."""
    factors: dict[str, Any] = {
        f"{key}_factor": _factor(start, letters)
        for key, letters in (("force_current", "K_i."), ("force_displacement", "K_s."))
    }
    return NOTHING_HOLDS(NOWHERE, **_pole(start), **factors)


def _pole(start: Model) -> dict[str, Any]:
    loop = NominalLoop(start.rig)
    pole, (bending, _) = start.poles()[0], loop.worst_mode
    return {
        "frequency_hz": float(abs(pole.imag)) / (2.0 * np.pi),
        "growth_per_s": float(pole.real),
        "mode": f"bending ({bending})" if bending else "rigid-body",
    }


def _factor(start: Model, letters: str) -> float | None:
    """The factor nearest to 1 on all parameters of a kind that makes the loop stable."""
    own = {p.name: p.value for p in start.parameters if p.name.startswith(letters)}
    for factor in sorted(FACTORS, key=lambda factor: abs(np.log(factor))):
        if start.with_values({name: factor * value for name, value in own.items()}).is_stable:
            return float(factor)
    return None


def _held(start: Model, records: Sequence[Measurement], effects: Sequence[Effect]) -> Iterator[Model]:
    """The model with each effect at the values that make its loop most stable, if any do."""
    knows_command = bool(records) and all(record.has_known_command for record in records)
    for effect in effects:
        home = start.home_of(effect)
        if home is None or effect.in_record or is_nonlinear(home, effect) or (effect.within_command and knows_command):
            continue  # no pole tells whether what is not linear holds a loop
        variants = effect.variants(Seen(home, {}, points=start.points))
        some = variants[:: max(1, len(variants) // MOST_VARIANTS)]
        tried = [model for variant in some for model in _with(start, variant, home)]
        best = max(tried, key=lambda model: model.decay_rate, default=None)
        if best is not None:
            yield best


def _with(start: Model, variant: Effect, home: Rig) -> Iterator[Model]:
    """Stable models with an effect at multiples of its probes, and where it is far from the rig file's values."""
    known = {p.name: p for p in variant.parameters(home)}
    probes = variant.probes(home)
    multiples = [{name: factor * value for name, value in own.items()} for own in probes for factor in MULTIPLES]
    for values in (*multiples, *variant.far_starts(home)):
        if not all(known[name].lower <= value <= known[name].upper for name, value in values.items()):
            continue
        try:
            model = start.add(variant, values)
            is_stable = model.is_stable
        except ModelError:
            continue
        if is_stable:
            yield model
