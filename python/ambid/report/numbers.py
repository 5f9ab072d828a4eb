"""What a diagnosis does not hold: the model before, standard errors, units, figures of the rig, and files read."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ambid.diagnosis import Diagnosis, Step
from ambid.effects import Effect
from ambid.loop.geometry import rotor_of
from ambid.model import Model
from ambid.noise import Comparison
from ambid.reading import Provenance
from ambid.report.words import quantity
from ambid.results import speed_text
from ambid.rig import FiniteElementRotor, PointMassRotor, Rig
from ambid.rotor import assemble


def base_model(diagnosis: Diagnosis) -> Model:
    """The model before the first step."""
    return diagnosis.history[0].model.with_substeps(None)


def last_step(diagnosis: Diagnosis) -> Step:
    """The step whose model is the last one; not that of a step that led nowhere and was taken back."""
    names = tuple(effect.name for effect in diagnosis.model.effects)
    return next(step for step in reversed(diagnosis.history) if step.effects == names)


def ceiling_of_y(comparison: Comparison | None) -> float:
    """Fit of y that the exact model would reach [%], mean over the axes; NaN where that is not known."""
    return np.nan if comparison is None else comparison.noise_ceiling_percent["average"]


def standard_errors(diagnosis: Diagnosis) -> dict[str, float]:
    """Of every parameter of the last model; NaN where they are not known."""
    return {name: np.nan if p.std_error is None else p.std_error for name, p in diagnosis.parameters.items()}


def units(effect: Effect, rig: Rig) -> dict[str, str]:
    """Units of an effect's parameters by name."""
    return {p.name: p.unit for p in effect.parameters(rig)}


def rig_figures(rig: Rig, points: Sequence[Rig] = ()) -> list[tuple[str, str]]:
    """What the rig file says, the figures of its rotor, and further operating points."""
    places = sorted({z for bearing in rig.bearings for z in (bearing.position, bearing.sensor_position)})
    frequencies = rotor_of(rig).frequencies_rad_s
    bending = ", ".join(f"{f / (2.0 * np.pi):.1f}" for f in frequencies if f > 0.0)
    rotor = [("bending modes kept", f"{bending} Hz, free at rest" if bending else "none, a rigid rotor")]
    if isinstance(rig.rotor, FiniteElementRotor):
        beam = assemble(rig.rotor, places)
        rotor.insert(0, ("rotor", f"{beam.mass:.2f} kg, transverse inertia {beam.transverse_inertia:.3f} kg m²"))
    elif isinstance(rig.rotor, PointMassRotor):
        rotor.insert(0, ("rotor", f"{rig.rotor.mass:.3g} kg, a plain mass on one axis"))
    controller = rig.controller
    delay = f", {controller.delay_samples:g} samples of delay" if controller.is_digital else ""
    return [
        ("machine", rig.name),
        *rotor,
        ("speed", speed_text(rig.speed)),
        ("amplifier", f"lag of {quantity(rig.amplifier.time_constant, 's')}"),
        ("controller", f"{controller.kind.replace('_', ' ')}, {controller.implementation}{delay}"),  # type: ignore[attr-defined]
        ("sample rate", f"{rig.sample_rate:g} Hz"),
        *(("also at", f"{point.name}: {_bias(point)}, {speed_text(point.speed)}") for point in points),
    ]


def _bias(rig: Rig) -> str:
    return ", ".join(f"{bearing.name} {bearing.bias_current:g} A" for bearing in rig.bearings)


@dataclass(frozen=True)
class File:
    """A rig file or a record.

    Attributes
    ----------
    name, role : str
    size : int or None
        Bytes; None where nothing was read.
    sha256 : str
        The first digits, of what was read; why there are none otherwise.
    """

    name: str
    role: str
    size: int | None
    sha256: str


def files_of(diagnosis: Diagnosis) -> list[File]:
    """Rig files, records and records for validation, each once."""
    return list(dict.fromkeys(_file(*found) for found in _named(diagnosis)))


def _named(diagnosis: Diagnosis) -> Iterator[tuple[str, str, Path | None, Provenance | None]]:
    for rig in (diagnosis.model.rig, *diagnosis.model.points):
        yield rig.name, "rig", rig.path, rig.provenance
    for role, records in (("record", diagnosis.records), ("validation", diagnosis.validation)):
        for record in records:
            yield record.name, role, record.path, record.provenance


def _file(name: str, role: str, path: Path | None, read: Provenance | None) -> File:
    if read is None or path is None:
        return File(name if path is None else path.name, role, None, "made in memory, read from no file")
    return File(path.name, role, read.size, read.sha256[:16])  # which two files share by chance in one of 2e19 cases
