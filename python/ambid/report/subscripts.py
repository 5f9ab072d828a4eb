"""Symbols of a finished page, such as K_i, with their subscripts."""

from __future__ import annotations

import re

SYMBOLS = {"K_i": "K", "K_s": "K", "tau_e": "τ", "i_e": "i", "i_c": "i", "i_ref": "i"}
"""What stands before the subscript, which is the part behind the ``_``."""
_SYMBOL = re.compile(rf"\b({'|'.join(SYMBOLS)})(?![A-Za-z0-9_])")
_PIECE = re.compile(r"(<(style|title|code)\b.*?</\2>|<[^>]*>)|([^<]+)", re.DOTALL)
"""A tag, or an element that is left as it is; or text."""


def with_subscripts(page: str) -> str:
    """The page with subscripts in its text; names of files and effects, in ``code``, stay as they are typed."""
    return _PIECE.sub(lambda found: found[1] or _SYMBOL.sub(_set, found[3]), page)


def _set(found: re.Match[str]) -> str:
    return f"{SYMBOLS[found[1]]}<sub>{found[1].partition('_')[2]}</sub>"
