"""Nested tables as the text of a TOML file, which reads back to the same values, to the last bit."""

import json
from collections.abc import Iterator
from typing import Any


def toml_text(table: dict[str, Any]) -> str:
    """Write a table with all that is in it.

    Parameters
    ----------
    table : dict
        Of texts, truths, numbers, nested tuples of numbers, dicts (tables), and tuples of dicts (arrays of tables).
    """
    return "\n".join(_lines(table, "")).lstrip() + "\n"


def _lines(table: dict[str, Any], prefix: str) -> Iterator[str]:
    """Write a table: its plain values first, then the tables in it, then the arrays of tables."""
    inner = {key: value for key, value in table.items() if isinstance(value, dict)}
    arrays = {
        key: value for key, value in table.items() if isinstance(value, tuple) and value and isinstance(value[0], dict)
    }
    for key, value in table.items():
        if key not in inner and key not in arrays:
            yield f"{key} = {_value(value)}"
    for key, value in inner.items():
        yield from ("", f"[{prefix}{key}]")
        yield from _lines(value, f"{prefix}{key}.")
    for key, entries in arrays.items():
        for entry in entries:
            yield from ("", f"[[{prefix}{key}]]")
            yield from _lines(entry, f"{prefix}{key}.")


def _value(value: Any) -> str:
    """Write a text, a truth, a number, or a nested tuple of numbers; `repr` of a float reads back to the same float."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return f"[{', '.join(_value(entry) for entry in value)}]"
    return repr(value)
