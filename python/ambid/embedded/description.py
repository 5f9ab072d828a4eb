"""``modelDescription.xml`` of a functional mock-up unit, FMI 2.0 and 3.0 for co-simulation."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ambid.channels import Channel
from ambid.errors import printable
from ambid.model import Model

BASE_UNITS: dict[str, dict[str, int]] = {
    **{base: {base: 1} for base in ("A", "m", "s", "kg", "rad")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}
"""Exponents of units that others such as ``N s/m`` are made of."""


@dataclass(frozen=True)
class _Variable:
    name: str
    unit: str
    causality: str
    variability: str
    start: float | None = None
    meaning: str = ""


def identifier(name: str) -> str:
    """The name of a rig as one that C allows, which the library of a unit has."""
    own = re.sub(r"\W", "_", name, flags=re.ASCII)[:50]
    return own if re.match(r"[A-Za-z]", own) else f"rig_{own}"


def description(model: Model, token: str, fmi: int) -> bytes:
    """The description of a model's unit.

    Parameters
    ----------
    model : Model
    token : str
        By which the library knows that the model in the resources is this one.
    fmi : int
        2 or 3.
    """
    variables = list(_variables(model))
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": printable(model.rig.name) or "rig",
            ("guid" if fmi == 2 else "instantiationToken"): token,
            "description": "Closed loop of active magnetic bearings, SI units; i_ref = -(controller of y) + i_e",
            "generationTool": f"ambid {version('ambid')}",
            "variableNamingConvention": "flat",
        },
    )
    step = repr(model.loop.sample_time)
    ways = {"modelIdentifier": identifier(model.rig.name), "canHandleVariableCommunicationStepSize": "true"}
    if fmi == 3:
        ways["fixedInternalStepSize"] = step
    SubElement(root, "CoSimulation", ways)
    units = SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(variable.unit for variable in variables if variable.unit != "1"):
        element = SubElement(units, "Unit", name=unit)
        if of_base := exponents(unit):
            SubElement(element, "BaseUnit", {base: str(power) for base, power in of_base.items()})
    SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    own = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        _write(own, reference, variable, fmi)
    _structure(root, model, fmi)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def exponents(unit: str) -> dict[str, int]:
    """Exponents of a unit such as ``m/s^2``, by which importers compare it; none of one that goes by its name."""
    found: Counter[str] = Counter()
    for sign, part in zip((1, -1), unit.split("/"), strict=False):
        for factor in part.split():
            name, _, power = factor.partition("^")
            if name not in BASE_UNITS or not (power or "1").isdigit() or unit.count("/") > 1:
                return {}
            for base, own in BASE_UNITS[name].items():
                found[base] += sign * own * int(power or 1)
    return {base: power for base, power in found.items() if power}


def _variables(model: Model) -> Iterator[_Variable]:
    """In the order of their references."""
    for name in model.loop.inputs:
        yield _Variable(name, _unit(name), "input", "discrete", 0.0, "held over a sample")
    for name in model.loop.outputs:
        yield _Variable(name, _unit(name), "output", "continuous")
    for p in model.parameters:
        yield _Variable(p.name, p.unit, "parameter", "fixed", p.value)
    yield _Variable("time", "s", "independent", "continuous")


def _unit(channel: str) -> str:
    """Waves of disturbances have none."""
    own = Channel.of(channel)
    return "1" if own is None else own.signal.unit


def _write(parent: Element, reference: int, variable: _Variable, fmi: int) -> None:
    shared = {
        "name": printable(variable.name),
        "valueReference": str(reference),
        "causality": variable.causality,
        "variability": variable.variability,
    }
    if variable.meaning:
        shared["description"] = variable.meaning
    value = {} if variable.unit == "1" else {"unit": variable.unit}
    if variable.start is not None:
        value["start"] = repr(float(variable.start))
    if fmi == 3:
        SubElement(parent, "Float64", shared | value)
    else:
        SubElement(SubElement(parent, "ScalarVariable", shared), "Real", value)


def _structure(root: Element, model: Model, fmi: int) -> None:
    """The outputs, and which inputs they follow at once, which is known of a linear loop."""
    inputs, outputs = len(model.loop.inputs), len(model.loop.outputs)
    # version 2 counts variables from one, version 3 takes their references
    first, name = (1, "index") if fmi == 2 else (0, "valueReference")
    unknowns = [{name: str(first + inputs + k)} for k in range(outputs)]
    followed: list[dict[str, str]] = [{}] * outputs
    if model.is_linear:
        D = model.loop.state_space(model.theta)[3]
        followed = [{"dependencies": " ".join(str(first + j) for j in row.nonzero()[0])} for row in D]
    structure = SubElement(root, "ModelStructure")
    lists = [("Output", [a | b for a, b in zip(unknowns, followed, strict=True)]), ("InitialUnknown", unknowns)]
    for kind, members in lists:
        parent = structure if fmi == 3 else SubElement(structure, f"{kind}s")
        for member in members:
            SubElement(parent, kind if fmi == 3 else "Unknown", member)
