"""The rig file of the demo, of repeated tables of the rotor only the first."""

from __future__ import annotations

import re
from pathlib import Path

from ambid.demo import DATA

REPEATED = ("[[rotor.section]]", "[[rotor.disk]]")


def generate(drawn: Path) -> str:
    """The file as a block of TOML."""
    tables = re.split(r"\n(?=\[)", (DATA / "rig.toml").read_text(encoding="utf-8"))
    kept: list[str] = []
    for table in tables:
        if kept and table.startswith(REPEATED) and kept[-1].splitlines()[0] == table.splitlines()[0]:
            continue
        kept.append(table)
    more = [f"{table.rstrip()}\n# and more\n" if table.startswith(REPEATED) else table for table in kept]
    return "```toml\n" + "\n".join(more).rstrip() + "\n```"
