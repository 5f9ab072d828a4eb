"""The packages of `ambid` in the order in which they may import each other, with what each is for."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path

from words import table

PROJECT = Path(__file__).parents[3] / "pyproject.toml"


def generate(drawn: Path) -> str:
    """A table of the packages, from the layers that import-linter holds, the lowest first."""
    contracts = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    names = [name.strip() for layer in reversed(layers) for name in layer.split("|")]
    return table(["package", "what it is for"], [[f"`ambid.{name}`", _summary(name)] for name in names])


def _summary(name: str) -> str:
    return (importlib.import_module(f"ambid.{name}").__doc__ or "").strip().partition("\n")[0]
