"""The command that does what a result says is to be done next: rooms below do not know the command line."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable

from ambid.findings import Finding

DIAGNOSE = "ambid diagnose RIG RECORD"
COMMANDS = {
    "deflection_left_out": "ambid static-load RIG LOADS --deflection",
    "next_validate": "ambid compare RIG RECORD --model MODEL",
    "next_diagnose": DIAGNOSE,
    "next_excite_and_diagnose": DIAGNOSE,
    "next_fit_force_law": f"{DIAGNOSE} --effects {{effect}}",
    "next_lower_tolerance": f"{DIAGNOSE} --tolerance {{tolerance:.2f}}",
    "next_judge_residual": f"{DIAGNOSE} --tolerance J",
    "next_simulate_experiments": f"{DIAGNOSE} --next",
    "next_mend": "ambid design RIG",
    "next_begin_anew": "ambid campaign {campaign}",
    "next_validate_models": "ambid compare RIG RECORD",
    "next_diagnose_kind": "ambid diagnose {rig} {record}[ --validate {validate}]",
}
"""By code of what is to be done, or of what is found, with values of its finding; a name in capitals is an argument of
one's own, and what stands in square brackets is left out where its value is not known."""
OPTIONAL = re.compile(r"\[([^{]*\{(\w+)\})\]")


def command_of(steps: Iterable[Finding]) -> str:
    """Of the first of these that a command does; empty where none does."""
    step = next((step for step in steps if step.code in COMMANDS), None)
    if step is None:
        return ""
    known = {
        name: value if isinstance(value, float) else shlex.quote(str(value)) for name, value in step.values.items()
    }
    text = OPTIONAL.sub(lambda part: "" if step.values[part[2]] is None else part[1], COMMANDS[step.code])
    return text.format_map(known)


def with_command(text: str, command: str) -> str:
    """What is printed, with the command where there is one."""
    return f"{text}\n  {command}" if command else text
