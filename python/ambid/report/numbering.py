"""Numbers of figures and tables, given in the order in which the text first speaks of them."""

from __future__ import annotations

from collections.abc import Hashable

from markupsafe import Markup


class Numbering:
    """Numbers of one kind, such as figures; what the text does not speak of has none, and cannot be shown.

    Parameters
    ----------
    word : str
        Such as ``Figure``.
    """

    def __init__(self, word: str) -> None:
        self.word = word
        self._known: dict[Hashable, int] = {}

    def see(self, key: Hashable) -> Markup:
        """A link to it, such as ``Figure 3``, for the text."""
        number = self._known.setdefault(key, len(self._known) + 1)
        return Markup('<a href="#{}">{}&nbsp;{}</a>').format(self.anchor(key), self.word, number)

    def label(self, key: Hashable) -> str:
        """Its name, such as ``Figure 3``, for the caption."""
        return f"{self.word} {self._known[key]}"

    def anchor(self, key: Hashable) -> str:
        """Where its links lead."""
        return f"{self.word.lower()}-{self._known[key]}"
