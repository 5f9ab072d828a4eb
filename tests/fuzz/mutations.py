"""Seeded damage: to the bytes of any file, and to the fields of a text, a table or a structure."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator

NUMBERS = (
    "0", "-0.0", "1", "-1", "2.5", "1e-9", "1e9", "1e-300", "1e300", "1e308", "-1e308", "5e-324",
    "9" * 30, "1" + "0" * 400,
)  # fmt: skip
# fmt: off
WORDS = (
    "",
    " ",
    "x",
    "nan",
    "inf",
    "-inf",
    "None",
    "é位",
    "\x1b[31mred\x1b[0m",
    "\x00",
    "\u202e",
    "a" * 3000,
    "$\\frac$",
    "'",
    "%s{}",
)
TOML = (
    "nan", "inf", "-inf", "true", '""', '"x"', '"\\u001b[31m"', "[]", "[[]]", "[1.0, 2.0]", "[[1.0, 2.0], [3.0]]", "{}",
    "{ kind = 1 }", "1979-05-27", "00:00:00",
    "0x7fffffffffffffffffff", "[" * 3000, "[" * 200 + "]" * 200, '"' + "z" * 5000 + '"',
)  # fmt: skip


def pick(rng: Rng, choices: Any) -> Any:
    return choices[int(rng.integers(len(choices)))]


def in_bytes(rng: Rng, path: Path) -> None:
    """Flip, cut, double, insert, or overwrite bytes."""
    data = bytearray(path.read_bytes())
    for _ in range(int(rng.integers(1, 4))):
        if not data:
            break
        start = int(rng.integers(len(data))) if rng.random() < 0.5 else int(rng.integers(min(len(data), 400)))
        length = int(min(rng.integers(1, 2 ** int(rng.integers(1, 12))), len(data) - start))
        how = int(rng.integers(8))
        if how <= 2:
            for _ in range(int(rng.integers(1, 9))):
                data[int(rng.integers(start, start + length))] ^= 1 << int(rng.integers(8))
        elif how == 3:
            del data[start:]
        elif how == 4:
            data[start:start] = data[start : start + length]
        elif how == 5:
            del data[start : start + length]
        elif how == 6:
            data[start : start + length] = bytes([pick(rng, (0, 255, 127, 1, 32))]) * length
        else:
            data[start : start + 8] = pick(
                rng, (b"\xff" * 4, b"\x00" * 8, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\x7f" * 8)
            )
    path.write_bytes(bytes(data))


def toml(rng: Rng, path: Path) -> None:
    """Replace, remove, rename or double a line."""
    lines = path.read_text().splitlines()
    for _ in range(int(rng.integers(1, 3))):
        k = int(rng.integers(len(lines)))
        key, equals, value = lines[k].partition(" = ")
        how = int(rng.integers(14))
        if equals and how >= 7:
            lines[k] = f"{key} = {_other_numbers(rng, value)}"
        elif equals and how <= 3:
            odd = pick(rng, NUMBERS) if rng.random() < 0.5 else pick(rng, TOML)
            if value.startswith("[") and rng.random() < 0.7:
                entries = value.split("#")[0].split(",")
                j = int(rng.integers(len(entries)))
                bare = entries[j].strip()
                left, right = bare.count("["), bare.count("]")
                entries[j] = "[" * left + odd + "]" * right
                odd = ",".join(entries)
            lines[k] = f"{key} = {odd}"
        elif how == 4:
            del lines[k]
        elif how == 5:
            lines.insert(k, lines[k])
        else:
            lines[k] = pick(
                rng, ("[[bearing]]", "[rotor]", "[controller]", "x = 1", "[a.b]", f"{key}x = {value}", "= 1")
            )
        if not lines:
            break
    path.write_text("\n".join(lines) + "\n")


def _other_numbers(rng: Rng, text: str) -> str:
    """The text with some of its numbers times a factor: most of these pass the gates, and reach the arithmetic."""
    factors = (0.0, -1.0, 1e-3, 0.1, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, 1e6, 1e-300, 1e300)

    def other(found: re.Match[str]) -> str:
        return found[0] if rng.random() < 0.4 else repr(float(found[0]) * pick(rng, factors))

    return re.sub(r"(?<![\w\"'])\d[\d.]*(e[-+]?\d+)?", other, text)


def structure(rng: Rng, path: Path) -> None:
    """Replace, remove or add something anywhere in a JSON file."""
    content = json.loads(path.read_text())
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        for key in node if isinstance(node, dict) else range(len(node)):
            places.append((node, key))
            if isinstance(node[key], dict | list):
                walk(node[key])

    walk(content)
    odd = (
        None,
        True,
        0,
        -1,
        1e308,
        10**400,
        float("nan"),
        float("inf"),
        "",
        "x",
        "\x1b[31m",
        [],
        {},
        [[1]],
        {"a": 1},
        "9" * 5000,
    )
    for _ in range(int(rng.integers(1, 3))):
        node, key = pick(rng, places)
        how = int(rng.integers(8))
        if how <= 4:
            node[key] = pick(rng, odd)
        elif how == 5:
            node[key] = [node[key], node[key]]
        elif how == 6 and isinstance(node, dict):
            node[pick(rng, ("x", "name", "value", "\x1b[0m", "axis"))] = pick(rng, odd)
        elif how == 7 and isinstance(node, dict) and key in node:
            del node[key]
    text = json.dumps(content)
    if rng.random() < 0.05:
        depth = int(10 ** rng.uniform(2, 5))
        text = text.replace("null", "[" * depth + "]" * depth, 1)
    path.write_text(text)


def table(rng: Rng, path: Path) -> None:
    """Break cells, names, rows, columns and separators of a table."""
    lines = [line.split(",") for line in path.read_text().splitlines()]
    separator, end = ",", "\n"
    for _ in range(int(rng.integers(1, 3))):
        row, column = int(rng.integers(len(lines))), int(rng.integers(len(lines[0])))
        how = int(rng.integers(12))
        if how <= 1:
            lines[row][column % len(lines[row])] = pick(rng, NUMBERS + WORDS)
        elif how == 2:
            lines[0][column] = pick(rng, (*WORDS, *lines[0], "y.", "y.B_zeta", "t", "fs", "r.A_zeta", "i_ref.A_zeta"))
        elif how == 3:
            lines = [line[:column] + line[column + 1 :] for line in lines]
        elif how == 4:
            lines = [[*line, line[column % len(line)]] for line in lines]
        elif how == 5:
            lines = lines[: max(row, 1)]
        elif how == 6:
            lines[row:row] = lines[row : row + int(rng.integers(1, 300))]
        elif how == 7:
            del lines[row : row + int(rng.integers(1, 300))]
        elif how == 8:
            separator = pick(rng, (";", "\t", " ", ",,", "\x00", "|"))
        elif how == 9:
            end = pick(rng, ("\r\n", "\r", "\n\n", "\x00\n", ",\n"))
        else:
            lines[1:] = (
                [_changed(rng, line, column) for line in lines[1:]] if how == 10 else _scaled(rng, lines[1:], column)
            )
        if not lines or not lines[0]:
            break
    mark = "\ufeff" if rng.random() < 0.05 else ""
    path.write_text(mark + end.join(separator.join(line) for line in lines) + end)


def _changed(rng: Rng, line: list[str], column: int) -> list[str]:
    return (
        line if rng.random() < 0.9 or column >= len(line) else [*line[:column], pick(rng, NUMBERS), *line[column + 1 :]]
    )


def _scaled(rng: Rng, lines: list[list[str]], column: int) -> list[list[str]]:
    """All of a column times one factor, or turned into one value."""
    change: Callable[[str], str]
    factor = float(pick(rng, ("1e-300", "1e-9", "-1", "1e3", "1e6", "1e150", "1e300", "0")))

    def times(cell: str) -> str:
        try:
            return repr(float(cell) * factor)
        except ValueError:
            return cell

    change = times
    return [
        line if column >= len(line) else [*line[:column], change(line[column]), *line[column + 1 :]] for line in lines
    ]
