"""A loop as the file that the stepper in C reads, and as a functional mock-up unit.

The latter is a zip of the description, the native library, and the former in its resources.
"""

import platform
import sys
import zipfile
from pathlib import Path

from ambid.embedded.description import description, identifier
from ambid.errors import InputError, ModelError
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
