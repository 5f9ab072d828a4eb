"""The reference of the Python interface: all that is public at the top of `ambid` and of packages that users open."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path

import ambid
from ambid.errors import AmbidError

OPEN = ("rig", "effects", "robustness", "plot", "workbench")
"""Packages all of whose public names are documented, also those that are not at the top."""
FIRST = (
    "identification",
    "diagnosis",
    "robustness",
    "model",
    "record",
    "rig",
    "checking",
    "excitation",
    "designs",
    "monte_carlo",
    "noise",
    "campaigns",
)


def generate(drawn: Path) -> str:
    """A section of each package, functions before classes."""
    members: dict[str, dict[str, object]] = {}
    for name in ambid.__all__:
        found = getattr(ambid, name)
        if callable(found):
            members.setdefault(_package(found), {})[f"ambid.{name}"] = found
    for package in OPEN:
        face = importlib.import_module(f"ambid.{package}")
        rows = {id(found) for own in members.values() for found in own.values()}
        more = {f"{face.__name__}.{name}": getattr(face, name) for name in face.__all__}
        members.setdefault(package, {}).update(
            {name: found for name, found in more.items() if callable(found) and id(found) not in rows}
        )
    order = sorted(members, key=lambda package: FIRST.index(package) if package in FIRST else len(FIRST))
    return "\n\n".join(_section(package, members[package]) for package in order)


def _package(found: object) -> str:
    """Name of the package of `ambid` that something comes from; of errors, theirs."""
    if inspect.isclass(found) and issubclass(found, AmbidError):
        return "errors"
    package = inspect.getmodule(found).__name__.split(".")[1]  # type: ignore[union-attr]
    return "effects" if package == "loop" else package


def _section(package: str, members: dict[str, object]) -> str:
    summary = (importlib.import_module(f"ambid.{package}").__doc__ or "").strip().splitlines()[0]
    functions = [name for name, found in members.items() if inspect.isfunction(found)]
    classes = [name for name, found in members.items() if inspect.isclass(found)]
    lines = [f".. autofunction:: {name}" for name in functions]
    for name in classes:
        lines += [f".. autoclass:: {name}", "   :members:", "   :exclude-members: model_post_init", ""]
    return "\n".join([f"## ambid.{package}", "", summary, "", "```{eval-rst}", *lines, "```"])
