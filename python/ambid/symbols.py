"""Symbols such as K_i, set with their subscripts: on a page, in a picture, in LaTeX."""

import re

SYMBOLS = {"K_i": "K", "K_s": "K", "tau_e": "τ", "i_e": "i", "i_c": "i", "i_ref": "i"}
"""What stands before the subscript, which is the part behind the ``_``."""
_SYMBOL = re.compile(rf"\b({'|'.join(SYMBOLS)})(?![A-Za-z0-9_])")
_PIECE = re.compile(r"(<(style|title|code)\b.*?</\2>|<[^>]*>)|([^<]+)", re.DOTALL)
"""A tag, or an element that is left as it is; or text."""
_ESCAPED = str.maketrans({"%": r"\%", "_": r"\_"})
"""What LaTeX would take for a command."""


def in_page(page: str) -> str:
    """An HTML page with subscripts in its text; names of files and effects, in ``code``, stay as they are typed."""
    return _PIECE.sub(lambda found: found[1] or _set(found[3], "{}<sub>{}</sub>"), page)


def in_picture(text: str) -> tuple[str, bool]:
    """A line for matplotlib, and whether it is one with formulas: a ``$`` that was there before begins none."""
    if _SYMBOL.search(text) is None:
        return text, False
    return _set(text.replace("$", r"\$"), r"$\mathregular{{{}_{{{}}}}}$"), True


def in_latex(text: str) -> str:
    """A text with symbols as formulas, and what LaTeX would take for a command escaped."""
    parts = _SYMBOL.split(text)  # every second one is a symbol
    set_parts = (_set(part, "${}_{{{}}}$") if k % 2 else part.translate(_ESCAPED) for k, part in enumerate(parts))
    return "".join(set_parts).replace("τ", r"\tau")


def _set(text: str, pattern: str) -> str:
    return _SYMBOL.sub(lambda found: pattern.format(SYMBOLS[found[1]], found[1].partition("_")[2]), text)
