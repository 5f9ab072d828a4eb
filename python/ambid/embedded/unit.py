"""A loop as the file that the stepper in C reads, and as a functional mock-up unit.

The latter is a zip of its description (FMI 2.0 and 3.0 for co-simulation), the native library, and the former in its
resources.
"""

import platform
import re
import sys
import zipfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from ambid.channels import Channel
from ambid.errors import InputError, ModelError, printable
from ambid.model import Model
from ambid.writing import whole_file

NATIVE = Path(__file__).with_name("native")
"""Where the installation keeps the library of the stepper."""
LIBRARIES = {"linux": "libambid.so", "darwin": "libambid.dylib", "win32": "ambid.dll"}
FOLDERS = {
    ("linux", "x86_64"): {2: "linux64", 3: "x86_64-linux"},
    ("linux", "aarch64"): {2: "aarch64-linux", 3: "aarch64-linux"},
    ("darwin", "x86_64"): {2: "darwin64", 3: "x86_64-darwin"},
    ("darwin", "arm64"): {2: "darwin64", 3: "aarch64-darwin"},
    ("win32", "AMD64"): {2: "win64", 3: "x86_64-windows"},
}
"""Names of platforms in a unit, by version of the standard."""
BASE_UNITS: dict[str, dict[str, int]] = {
    **{base: {base: 1} for base in ("A", "m", "s", "kg", "rad")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "T": {"kg": 1, "s": -2, "A": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
}
"""Exponents of units that others such as ``N s/m`` are made of."""


def to_stepper(model: Model, path: str | Path) -> None:
    """Write the closed loop for the stepper in C, which needs no Python: see ``ambid.h``.

    It steps as `Model.simulator` does, to rounding, nonlinear effects too; SI units, inputs and outputs in the order of
    ``model.loop.inputs`` and ``model.loop.outputs``.

    Parameters
    ----------
    model : Model
        At its own rig's operating point.
    path : str or Path

    Raises
    ------
    ModelError
        If the loop is too large to be stepped: more than 1024 states, commands under way among them.
    """
    content = _packed(model)
    with whole_file(path) as stream:
        stream.write(content)


def to_fmu(model: Model, path: str | Path, *, fmi: int = 2) -> None:
    """Write the closed loop as a functional mock-up unit for co-simulation, which needs no Python and no compiler.

    Its inputs and outputs have the names of the channels (``i_e.A_zeta``; ``y.A_zeta``, ``i_c.A_zeta``), its parameters
    those of the model; they may be set until the initialization ends. It goes on by whole samples of the rig: a
    communication step that is no whole multiple is an error that says so.

    Parameters
    ----------
    model : Model
        At its own rig's operating point.
    path : str or Path
        With the suffix .fmu. It runs on the platform that it was written on.
    fmi : int
        Version of the standard, 2 or 3.

    Raises
    ------
    ModelError
        If the suffix or the version is another, and as for `to_stepper`.
    InputError
        If the installation has no native library for this platform.
    """
    path = Path(path)
    require_fmu(path, fmi)
    library = _library()
    content, name = _packed(model), identifier(model.rig.name)
    # bytes at the end of a stepper file; they are the token by which description and model know each other
    token = f"{int.from_bytes(content[-8:], 'little'):016x}"
    folder = FOLDERS[sys.platform, platform.machine()][fmi]
    parts = {
        "modelDescription.xml": description(model, token, fmi),
        "resources/model.stepper": content,
        f"binaries/{folder}/{name}{library.suffix}": library.read_bytes(),
    }
    with whole_file(path) as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for part, data in parts.items():
            # a date of its own, so that equal models are equal files
            archive.writestr(zipfile.ZipInfo(part), data, zipfile.ZIP_DEFLATED)


def _packed(model: Model) -> bytes:
    """The file of the stepper; for its layout see ``rust/core/src/packed.rs``."""
    return model.loop.packed(model.theta, model.names)


def require_fmu(path: Path, fmi: int) -> None:
    """Refuse a name or a version that no unit has.

    Raises
    ------
    ModelError
    """
    if path.suffix.lower() != ".fmu":
        raise ModelError(f"{path}: the suffix is {path.suffix or 'missing'}; expected .fmu")
    if fmi not in (2, 3):
        raise ModelError(f"fmi = {fmi}: expected 2 or 3, the version of the standard")


def _library() -> Path:
    """The native library of this platform.

    Raises
    ------
    InputError
        If there is none.
    """
    here = (sys.platform, platform.machine())
    name = LIBRARIES.get(sys.platform)
    if name is None or here not in FOLDERS:
        raise InputError(f"units are not made on {' '.join(here)}; write a stepper file, and use the library in C")
    found = NATIVE / name
    if not found.is_file():
        raise InputError(
            f"{found}: the native library is not there; install with pip install ., or in a checkout run cargo build "
            f"--release -p ambid-c and copy target/release/{name} there"
        )
    return found


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
    """``modelDescription.xml`` of a model's unit.

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
