"""What an effect finds in the plant that it is attached to."""

from __future__ import annotations

import inspect
from pathlib import Path

from ambid.effects import Effect
from words import first_paragraph, paragraphs, table


def generate(drawn: Path) -> str:
    """Signals of the plant, and its methods, from the class that `attach` is given."""
    plant = inspect.get_annotations(Effect.attach, eval_str=True)["plant"]
    rows = [
        [f"`{name}({', '.join(list(inspect.signature(method).parameters)[1:])})`", first_paragraph(method)]
        for owner in plant.__mro__
        for name, method in vars(owner).items()
        if inspect.isfunction(method) and not name.startswith("_")
    ]
    return f"{paragraphs(plant)}\n\n{table(['method', 'what it does'], rows)}"
