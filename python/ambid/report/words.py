"""Numbers and names as an engineer writes them, and the words of the report."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from ambid.diagnosis import Diagnosis
from ambid.diagnosis.moves import Moved
from ambid.identification import ParameterEstimate
from ambid.noise.chance import ADEQUATE
from ambid.plot.style import misfit_text

OWN_UNITS = {"kg m": (-6, "g mm")}
"""Units that balancing machines and their standards use, and their powers of ten."""
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
    "mostly explained": "The effects explain nearly all of the excess misfit, and what is left is above the bound: "
    "their formulas only approximate this machine, or something smaller is missing.",
    "good enough": f"The misfit is within {ADEQUATE:.2f}, or what was asked for, but above what chance brings: "
    "something small is missing, and the report says where it is largest.",
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


def prefixed(value: float, unit: str) -> tuple[int, str]:
    """Power of ten and unit with its prefix in which a value reads well; no unit of a ratio."""
    if unit in OWN_UNITS:
        return OWN_UNITS[unit]
    power = 0
    # the first symbol of a unit may carry a prefix, to the power of one
    if re.match(r"(s|m|N|A|Hz|rad)(?=$|[ /])", unit) and value != 0.0 and np.isfinite(value):
        power = int(np.clip(3 * np.floor(np.log10(abs(value)) / 3.0), -9, 9))
    return power, "" if unit == "1" else f"{PREFIXES[power]}{unit}"


def quantity(value: float, unit: str, *, digits: int = 4) -> str:
    """A value with its unit and prefix: ``249.9 µs``."""
    power, name = prefixed(value, unit)
    scaled, name = value / 10.0**power, f" {name}" if name else ""
    text = f"{scaled:#.{digits}g}".rstrip(".") if 1e-3 <= abs(scaled) < 10.0**digits else number(scaled, digits)
    return f"{text}{name}".replace("-", "−")


def values(start: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Predicted values of an effect's parameters, such as ``cross_stiffness 553 kN/m, damping 217 N s/m``."""
    return ", ".join(f"{name} {quantity(value, units.get(name, '1'), digits=3)}" for name, value in start.items())


@dataclass(frozen=True)
class Row:
    """A parameter, or a setting of an effect, as texts, in one unit and with as many decimals as its interval allows.

    Attributes
    ----------
    name, unit, of_rig, before, now, interval, percent, errors : str
        Of the rig file, of the base model, of the last model, its 95 % interval, and by how much it moved.
    """

    name: str
    unit: str
    of_rig: str
    before: str
    now: str
    interval: str
    percent: str
    errors: str

    @classmethod
    def of(
        cls, name: str, own: ParameterEstimate, of_rig: float | None, before: float | None, moved: Moved | None
    ) -> Row:
        """Of a parameter; None for what is not known of it."""
        half = own.std_error or np.nan
        power, unit = _with_power(own.value or float(np.nan_to_num(half)), own.unit)

        def shown(value: float | None) -> str:
            if value is None or not np.isfinite(value):
                return "–"
            scaled, error = value / 10.0**power, half / 10.0**power
            if not np.isfinite(error) or error <= 0.0:
                return number(scaled)
            text = f"{scaled:.{int(np.clip(1 - np.floor(np.log10(error)), 0, 9))}f}"
            return text.replace("-", "−")

        percent, errors = (None, None) if moved is None else (moved.percent, moved.errors)
        return cls(
            name,
            unit,
            "–" if of_rig is None else number(of_rig / 10.0**power),
            shown(before),
            shown(own.value),
            "–" if own.ci95 is None else " to ".join(map(shown, own.ci95)),
            signed(percent),
            signed(errors),
        )

    @classmethod
    def of_setting(cls, name: str, value: float, unit: str) -> Row:
        """Of a place or a frequency of an effect, which has no interval."""
        return cls(name, unit, "–", "–", number(value, 6), "–", "–", "–")


def _with_power(value: float, unit: str) -> tuple[int, str]:
    """As `prefixed`; small values whose unit carries no prefix have a power of ten before it."""
    power, name = prefixed(value, unit)
    if power or not 0.0 < abs(value) < 1e-3:
        return power, name
    power = int(3 * np.floor(np.log10(abs(value)) / 3.0))
    return power, f"10{str(power).translate(SUPERSCRIPT)} {name}".rstrip()


def most_moved(changes: Sequence[Moved]) -> str:
    """Parameters with their moves, such as ``K_s.A_zeta by +776 standard errors, away from the rig file's value``."""
    parts = []
    for own in changes:
        text = f"{own.name} by {signed(own.errors)} standard errors"
        if own.nominal is not None:
            text += f", {'towards' if own.is_nearer else 'away from'} the rig file's value"
        parts.append(text)
    return "; ".join(parts)


def signed(value: float | None) -> str:
    """A change, with its sign."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{'+' if value > 0.0 else ''}{number(value, 3)}"


def peak(value: float) -> str:
    """A peak of the sensitivity."""
    return f"{value:.3f}" if np.isfinite(value) else "unstable"


def decibel(value: float) -> str:
    """The same [dB]."""
    return f"{20.0 * np.log10(value):.1f}"


def date(when: datetime) -> str:
    """Day, time and zone."""
    return f"{when.day} {when:%B %Y, %H:%M %Z}"


def left_sentence(diagnosis: Diagnosis) -> str:
    """How many cells of the last model's map hold more than chance may bring."""
    fit, maps = diagnosis.fit, diagnosis.left
    if fit is None or not maps:
        return "The noise of these records is not known, so that nothing can be said of what is left."
    cells = sum(int(np.isfinite(own.misfit).sum()) for own in maps)
    beyond = sum(int((own.misfit > own.by_chance[:, None]).sum()) for own in maps)
    largest = max(float(np.nanmax(own.misfit)) for own in maps)
    within, verb = "within" if fit.misfit <= fit.bound else "above", "holds" if beyond == 1 else "hold"
    return (
        f"The last model leaves a misfit of {misfit(fit.misfit)}, {within} its bound of {misfit(fit.bound)}: "
        f"{beyond or 'none'} of the {cells} cells of channel and band {verb} more than chance may bring, and the "
        f"largest of all holds {misfit(largest)} times noise."
    )


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
            return f"One of {sets} explains what the base model missed; these data cannot determine which: {fall}."
        case "none_of_the_candidates":
            return (
                f"Something is missing (misfit {misfit(before)}, where 1 is noise alone) that no effect of the "
                "catalogue explains; nothing was added."
            )
        case _:
            return "These data cannot decide whether physics is missing."
