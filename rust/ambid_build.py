"""Builds the wheel: maturin's, with the native library of the stepper in it, for functional mock-up units."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import maturin
from maturin import (  # noqa: F401  what pip asks a build for
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

ROOT = Path(__file__).parent.parent
NATIVE = ROOT / "python" / "ambid" / "embedded" / "native"
LIBRARY = {"darwin": "libambid.dylib", "win32": "ambid.dll"}.get(sys.platform, "libambid.so")


def build_wheel(
    wheel_directory: str, config_settings: dict | None = None, metadata_directory: str | None = None
) -> str:
    """See PEP 517."""
    _build_library()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(
    wheel_directory: str, config_settings: dict | None = None, metadata_directory: str | None = None
) -> str:
    """See PEP 660."""
    _build_library()
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


def _build_library() -> None:
    """Put the library where `ambid.embedded` looks for it, unless it is newer than its sources.

    With the Python face, so that both have dependencies of the same features, which are compiled once; but where that
    needs the linker's flags of maturin, whose settings compile that face anew.
    """
    sources = [ROOT / "Cargo.lock", ROOT / "Cargo.toml", *(ROOT / "rust").rglob("*.*")]
    if (built := NATIVE / LIBRARY).exists() and built.stat().st_mtime > max(own.stat().st_mtime for own in sources):
        return
    packages = ["-p", "ambid-c"] if sys.platform == "darwin" else ["-p", "ambid-c", "-p", "ambid-py"]
    subprocess.run(["cargo", "build", "--release", "--locked", *packages], cwd=ROOT, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
    NATIVE.mkdir(exist_ok=True)
    shutil.copyfile(ROOT / target / "release" / LIBRARY, built)
