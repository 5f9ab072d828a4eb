"""One machine at several operating points: which rigs may be fitted together, and what they share.

Sample rate, speed, bias current, air gap and controller may differ from record to record. The rotor and the places of
bearings and sensors may not. K_i and K_s belong to a bias current and gap; all other parameters are the machine's.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from ambid.channels import first_outputs, further, in_order
from ambid.errors import ModelError, RecordError
from ambid.loop.effect import Effect
from ambid.model.parameter import Parameter, nominal
from ambid.record import Measurement
from ambid.rig import Rig

OF_POINT = ("K_i", "K_s")
"""Parameters that every bias current and gap has of its own."""
OPERATING = ("bias_current", "air_gap")
"""Keys of a bearing that K_i and K_s belong to."""


def suffix(rig: Rig, reference: Rig) -> str:
    """What the names of K_i and K_s end in at the bias currents and gaps of a rig; nothing at those of the reference.

    Such as ``@8A``, ``@0.5mm`` or ``@8A-0.5mm``: what differs.
    """
    bias, gap = ([tuple(getattr(b, key) for b in own.bearings) for own in (rig, reference)] for key in OPERATING)
    own = [_text(bias[0], 1.0, "A")] if bias[0] != bias[1] else []
    own += [_text(gap[0], 1e3, "mm")] if gap[0] != gap[1] else []
    return f"@{'-'.join(own)}" if own else ""


def _text(values: tuple[float, ...], factor: float, unit: str) -> str:
    """One number if all bearings have the same."""
    shown = values[:1] if len(set(values)) == 1 else values
    return "-".join(f"{factor * value:g}" for value in shown) + unit


def nominal_of_points(reference: Rig, points: Sequence[Rig]) -> list[Parameter]:
    """K_i and K_s of each further bias current and gap, at the nominal values of the first rig that has them."""
    found: dict[str, Parameter] = {}
    for rig in points:
        end = suffix(rig, reference)
        for p in nominal(rig) if end else ():
            if p.name.startswith(OF_POINT):
                name = p.name + end
                found.setdefault(name, replace(p, name=name, slots=tuple(slot + end for slot in p.slots)))
    return list(found.values())


def further_points(reference: Rig, points: Sequence[Rig], records: Iterable[Measurement]) -> list[Rig]:
    """The points, and those of records that are not among them yet.

    Raises
    ------
    ModelError
        If a record is of another machine.
    """
    found = list(points)
    for record in records:
        if record.point is not None and record.point not in (reference, *found):
            require_same_machine(reference, record.point)
            found.append(record.point)
    return found


def outputs_of(measured: Measurement, rig: Rig) -> tuple[str, ...]:
    """Outputs that a loop of a rig is to have first for a measurement; none where y and i_c are all that it has.

    Raises
    ------
    RecordError
        If the machine has no such output.
    """
    found = first_outputs(tuple(measured.channels), rig.axes)
    for name in found:
        if lacking := rig.lacks(name):
            raise RecordError(
                f"{measured.path or measured.name}: {name} is not known of {rig.path or rig.name}: {lacking}"
            )
    return found


def selected_outputs(rig: Rig, channels: str | Iterable[str]) -> tuple[str, ...]:
    """Channels, or all of signals, beyond y and i_c, in the order of a record.

    Raises
    ------
    ModelError
        If the machine has no such output.
    """
    every, found = further(rig.outputs, rig.axes), list[str]()
    for name in (channels,) if isinstance(channels, str) else channels:
        own = [output for output in every if output == name or output.startswith(f"{name}.")]
        if not own:
            raise ModelError(
                f"{name} is no further output of {rig.path or rig.name}, which has {', '.join(every)}"
                f"{'; ' if '.' in name else ''}{rig.lacks(name) if '.' in name else ''}"
            )
        found += own
    return tuple(in_order(dict.fromkeys(found), rig.axes))


def parameters_at(
    rig: Rig, reference: Rig, points: Sequence[Rig], parameters: Sequence[Parameter], effects: Iterable[Effect]
) -> list[Parameter]:
    """All parameters of the machine, each with the slots that it fills at one of its operating points.

    Raises
    ------
    ModelError
        If no point has this bias current and gap, or the rig is one of another machine.
    """
    end = suffix(rig, reference)
    if end and end not in (suffix(other, reference) for other in points):
        raise ModelError(
            f"{rig.path or rig.name}: K_i and K_s at {end[1:]} are not in the model; fit it to a record of that bias "
            "current and gap too"
        )
    if rig not in points:
        require_same_machine(reference, rig)
    needed = {slot for p in nominal(rig) for slot in p.slots}
    needed |= {effect.slot(p.name) for effect in effects for p in effect.parameters(rig)}
    needed |= {slot for p in parameters if p.prior is not None for slot in p.slots}  # known of the machine, everywhere

    def here(slot: str) -> str:
        return slot.removesuffix(end) if slot.startswith(OF_POINT) and slot.endswith(end) else slot

    def is_of_point(slot: str) -> bool:
        return not slot.startswith(OF_POINT) or slot.partition("@")[2] == end.partition("@")[2]

    return [
        replace(p, slots=tuple(here(slot) for slot in p.slots if is_of_point(slot) and here(slot) in needed))
        for p in parameters
    ]


def require_same_machine(rig: Rig, other: Rig) -> None:
    """Refuse a rig that differs in more than sample rate, speed, bias, gaps, nominal values and controller.

    Raises
    ------
    ModelError
        Naming what differs.
    """
    different = {
        "axes": (", ".join(rig.axes), ", ".join(other.axes)),
        "rotor": (rig.rotor, other.rotor),
        "bearing positions": tuple([(b.position, b.sensor_position, b.tilt) for b in r.bearings] for r in (rig, other)),
        "amplifier": (rig.amplifier, other.amplifier),
        "actuator (has_lag)": (rig.actuator.has_lag, other.actuator.has_lag),
    }
    wrong = [name for name, (here, there) in different.items() if here != there]
    if wrong:
        where = other.path or other.name
        raise ModelError(
            f"{where}: {', '.join(wrong)} differ from those of {rig.path or rig.name}; records are fitted together "
            "only if they are of one machine. Sample rate, speed, bias currents, air gaps, nominal K_i and K_s and the "
            "controller may differ"
        )
