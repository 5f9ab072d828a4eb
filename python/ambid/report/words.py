"""Numbers and names as an engineer writes them, and the words of the report."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from ambid.diagnosis import Diagnosis
from ambid.noise.comparison import ADEQUATE
from ambid.plot.style import misfit_text

PREFIXED = re.compile(r"(s|m|N|A|Hz|rad)(?=$|[ /])")
"""A unit that may carry a prefix: its first symbol to the power of one."""
PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

GLOSSARY = {
    "fit": "Share of a channel that the simulation meets: 100 (1 − ‖y − ŷ‖ / ‖y − mean y‖), each mean removed; "
    "“fit of y” is the average over the displacements.",
    "ceiling": "The fit that the exact model would reach on this record; noise takes the rest. What a record begins "
    "with, its transient, is fitted with every model and is no noise.",
    "misfit": "J/dof: power of what repeats in the residual of y and i_c, in units of their noise. 1 is a model that "
    "is right; a fit close to its ceiling can hide a misfit of 60.",
    "bound": f"Misfit up to which a model may be right: {ADEQUATE:.2f}, or on a short record what chance brings.",
    "interval": "95 % confidence. Where the misfit is above its bound it is widened by what is left, and may still "
    "miss the truth: what is missing bends the parameters.",
    "score": "Fall of J that adding an effect would bring, predicted without refitting, beyond what the known "
    "parameters could absorb.",
    "p value": "How likely chance alone would reach such a score if the effect were absent.",
    "port": "Place in the loop where something may act: force at the magnets, current at the amplifiers, displacement "
    "at the sensors, or the reading of the current. One is named only where it explains more than the others beyond "
    "chance.",
    "in the main only": "The effects explain nearly all of the excess misfit, and what is left is above the bound: "
    "their formulas only approximate this machine, or something smaller is missing.",
    "slip": "An error of the rig file or the record that is ranked beside the physics: other gains of the controller, "
    "another scale of i_e.",
    "confusable": "Two effects whose responses look alike to more than 90 % in these data, after refitting the rest.",
    "validation": "Records that no parameter was fitted to; a step that makes them worse, beyond chance, is not taken.",
}


def number(value: float | None, digits: int = 4) -> str:
    """A number without exponent where that reads better; a dash for none."""
    if value is None or not np.isfinite(value):
        return "–"
    if 10.0**digits <= abs(value) < 1e9:
        return f"{value:,.0f}".replace(",", "\u202f").replace("-", "−")
    return f"{value:.{digits}g}".replace("-", "−")


def misfit(value: float | None) -> str:
    """A misfit J/dof."""
    if value is None or not np.isfinite(value):
        return "–"
    return misfit_text(value)


def percent(value: float | None, digits: int = 2) -> str:
    """A percentage, without its sign."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def quantity(value: float, unit: str, error: float | None = None, *, digits: int = 4) -> str:
    """A value with its unit, prefix and, where known, standard error: ``249.9 ± 0.1 µs``."""
    power = 0
    if PREFIXED.match(unit) and value != 0.0 and np.isfinite(value):
        power = int(np.clip(3 * np.floor(np.log10(abs(value)) / 3.0), -9, 9))
    scaled, name = value / 10.0**power, "" if unit == "1" else f" {PREFIXES[power]}{unit}"
    if error is None or not np.isfinite(error) or error <= 0.0:
        text = f"{scaled:#.{digits}g}".rstrip(".") if 1e-3 <= abs(scaled) < 10.0**digits else number(scaled, digits)
        return f"{text}{name}".replace("-", "−")
    deviation = error / 10.0**power
    decimals = int(np.clip(1 - np.floor(np.log10(deviation)), 0, 6))
    return f"{scaled:.{decimals}f} ± {deviation:.{decimals}f}{name}".replace("-", "−")


def p_value(chance: float) -> str:
    """A p-value from its natural logarithm, which may be far below the smallest number."""
    power = chance / np.log(10.0)
    if power > -3.0:
        return f"{10.0**power:.2g}"
    sign = "" if power > -300.0 else "< "
    return f"{sign}10{f'{max(power, -300.0):.0f}'.translate(SUPERSCRIPT)}"


def plain(name: str) -> str:
    """The name of an effect in running text."""
    return name.replace("_", " ")


def listed(names: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    *most, end = map(plain, names)
    return f"{', '.join(most)} {last} {end}" if most else end


def verdict_sentence(diagnosis: Diagnosis, before: float, after: float, validation: tuple[float, float] | None) -> str:
    """The verdict in one sentence.

    Parameters
    ----------
    diagnosis : Diagnosis
    before, after : float
        Misfit of the base model and of the last model; NaN where there is none.
    validation : tuple of float, optional
        The same on the records for validation.
    """
    fall = f"the misfit falls from {misfit(before)} to {misfit(after)}, where 1 is noise alone"
    if validation is not None:
        fall += f", and from {misfit(validation[0])} to {misfit(validation[1])} on data not used for choosing"
    match diagnosis.verdict:
        case "adequate":
            return (
                "Nothing is missing that these data can show, in this band and at this amplitude: "
                f"the misfit is {misfit(before)}, where 1 is noise alone."
            )
        case "explained":
            added = [effect for effect in diagnosis.model.effects if effect.name in diagnosis.effects]
            verb = "explains" if len(added) == 1 and not added[0].plural else "explain"
            return f"{listed(diagnosis.effects).capitalize()} {verb} what the base model missed: {fall}."
        case "ambiguous":
            sets = "; and one of ".join(listed(names, "or") for names in diagnosis.ambiguous_sets)
            return f"One of {sets} explains what the base model missed; these data cannot tell which: {fall}."
        case "none_of_the_candidates":
            return (
                f"Something is missing (misfit {misfit(before)}, where 1 is noise alone) that no effect of the "
                "catalogue explains; nothing was added."
            )
        case _:
            return "These data cannot decide whether physics is missing."
