"""Records and static loadings: formats, signals, gates and map, from the readers, the classes and their checks."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import ambid.record
from ambid.channels import SIGNALS
from ambid.record import ChannelMap, Record, StaticLoading
from words import first_paragraph, meanings, paragraphs, table

PATHS = {
    "drive": "none",
    "command": "none",
    "heard": "goes round the loop where the controller reads it",
    "recorder": "of the recorder alone",
}
"""What is said of the noise of each path."""


def generate(drawn: Path) -> str:
    """The sections of the page that follow from the code."""
    return "\n\n".join([_formats(), _signals(), _gates(), _map(), _static()])


def _modules() -> Iterator[ModuleType]:
    for info in pkgutil.walk_packages(ambid.record.__path__, f"{ambid.record.__name__}."):
        yield importlib.import_module(info.name)


def _constant(name: str) -> Any:
    """What a module of the room holds under a name."""
    return next(getattr(module, name) for module in _modules() if hasattr(module, name))


def _formats() -> str:
    rows = [[f"`{suffix}`", _packages(reader) or "nothing"] for suffix, reader in _constant("_READERS").items()]
    head = ["suffix", "needs beside ambid (all of them are in the extra `ambid[io]`)"]
    return f"## Formats\n\n{table(head, rows)}\n\nMATLAB v7.3 files are HDF5 inside."


def _packages(reader: Callable[..., Any]) -> str:
    """What a reader imports when it is called, itself or through another reader that it may hand over to."""
    source = inspect.getsource(reader)
    own = ", ".join(re.findall(r'extra\("(\w+)', source))
    others = {_packages(other) for other in _constant("_READERS").values() if _calls(reader, other)}
    return own or ", ".join(f"{other}, if such is inside" for other in others if other)


def _calls(reader: Callable[..., Any], other: Callable[..., Any]) -> bool:
    return other is not reader and f" {other.__name__}(" in inspect.getsource(reader)


def _signals() -> str:
    lines = meanings(Record, "Attributes")
    names = ["sample_rate", "axes", *_constant("OF_LOOP"), "further", "period"]
    rows = [[f"`{name}`", *lines[name]] for name in names]
    columns = [
        [f"`{own.name}`", " or ".join(own.at), own.meaning, own.unit, PATHS[own.path], own.gain and f"`{own.gain}`"]
        for own in SIGNALS.values()
    ]
    head = ["signal", "of each", "what it is", "unit", "its noise", "tolerance of its gain"]
    return (
        f"## What a record holds\n\n{paragraphs(Record)}\n\n{table(['in Python', 'type', 'meaning'], rows)}\n\n"
        f"{table(head, columns)}\n\n"
        f"In a table (`.csv`, `.parquet`, `.tdms`) each signal has a column an axis, such as `y.A_zeta`, beside `t` in "
        "s. In `.mat` and `.h5` a signal is an array of N x axes, beside `fs` in Hz or `t` in s, and `axes`, the names "
        "of its columns; an array of axes x N is turned, with a note. Further channels are arrays likewise, those of "
        "sensors in the order of the rig file, or members of structures, such as `b.A_zeta`."
    )


def _gates() -> str:
    rows = [
        [first_paragraph(function), f"`{function.__name__}`"]
        for module in _modules()
        for function in vars(module).values()
        if inspect.isfunction(function)
        and function.__module__ == module.__name__
        and function.__name__.startswith(("require_", "findings_of_", "sample_rate_of"))
    ]
    return (
        "## What every record passes\n\nEach gate refuses with what was found and what to do, or adds to "
        f"`record.findings`; nothing is dropped in silence. The numbers are among the [thresholds](thresholds.md).\n\n"
        f"{table(['gate', 'function'], rows)}"
    )


def _map() -> str:
    _, text = meanings(ChannelMap)["channels"]
    return f"## Other names and units: `--map`\n\n{paragraphs(ChannelMap)}\n\n{text}"


def _static() -> str:
    rows = [[f"`{name}`", *lines] for name, lines in meanings(StaticLoading, "Attributes").items()]
    return (
        f"## Static loading\n\n{paragraphs(StaticLoading)}\n\n{table(['in Python', 'type', 'meaning'], rows)}\n\n"
        "A `.csv` file has the columns `step`, `z`, `F_x`, `F_y` and `i_c.<axis>`, a row a step; "
        "it may have `b.<axis>`."
    )
