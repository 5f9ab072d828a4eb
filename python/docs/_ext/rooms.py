"""The packages of `ambid` in the order in which they may import each other, with what each is for."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
from graphlib import TopologicalSorter
from pathlib import Path

import ambid
from words import table

HIDDEN = ("_core",)


def generate(drawn: Path) -> str:
    """A table of the packages, each below all that it imports from."""
    names = [info.name for info in pkgutil.iter_modules(ambid.__path__) if info.name not in HIDDEN]
    needs = {name: _imports(name) & set(names) - {name} for name in names}
    rows = []
    for name in TopologicalSorter(needs).static_order():
        summary = (importlib.import_module(f"ambid.{name}").__doc__ or "").strip().splitlines()
        rows.append([f"`ambid.{name}`", summary[0] if summary else "", ", ".join(sorted(needs[name]))])
    return table(["package", "what it is for", "imports from"], rows)


def _imports(name: str) -> set[str]:
    """Packages of ambid that the modules of a package import from."""
    spec = importlib.util.find_spec(f"ambid.{name}")
    origin = Path(str(spec.origin))  # type: ignore[union-attr]
    files = origin.parent.rglob("*.py") if origin.name == "__init__.py" else [origin]
    found = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("ambid."):
                found.add(str(node.module).split(".")[1])
            elif isinstance(node, ast.ImportFrom) and node.module == "ambid":
                found.update(alias.name for alias in node.names)
    return found
