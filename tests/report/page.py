"""What a report says, taken from its HTML, which is checked to be whole and self-contained."""

import hashlib
import re
from html.parser import HTMLParser

VOID = {"meta", "img"}


def hash_of(path):
    """As the table of files has it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


class Page(HTMLParser):
    """Headings, figures, tables, references, classes and balance of the tags of a page.

    Attributes
    ----------
    headings : list of (int, str)
        Level and text.
    tables : dict of str to list
        Rows of texts of each table, by its key.
    classes : dict of str to list of str
        Texts of the elements of each class.
    images : dict of str to int
        Number of images under the last heading before them.
    findings : list of list of (str, str)
        Severity and code, of each list.
    """

    def __init__(self, html):
        super().__init__()
        assert html.lstrip().startswith("<!DOCTYPE")
        assert not re.search(r"https?://|<script|@import|url\(", html)
        assert not re.search(r"\bnan\b|\bNone\b|\binf\b", html)
        self.html, self.headings, self.sources, self.places, self.links = html, [], [], [], []
        self.tables, self.classes, self.images, self.findings = {}, {}, {}, []
        self._open, self._text = [], ""
        self.feed(html)
        self.close()
        assert not self._open
        assert all(source.startswith("data:image/") for source in self.sources)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if "src" in attrs:
            self.sources.append(attrs["src"])
            name = self.headings[-1][1]
            self.images[name] = self.images.get(name, 0) + 1
        if "href" in attrs:
            self.links.append(attrs["href"].removeprefix("#"))
        if "id" in attrs:
            self.places.append(attrs["id"])
            assert attrs["id"] in self.links  # the text speaks of it before it is shown
        if "data-key" in attrs:
            self._rows = self.tables.setdefault(attrs["data-key"], [])
        if tag == "ul" and attrs.get("class") == "findings":
            self.findings.append([])
        if "data-code" in attrs:
            self.findings[-1].append((attrs["class"], attrs["data-code"]))
        if tag == "tr":
            self._cells = []
        if tag not in VOID:
            self._open.append((tag, attrs.get("class", "").split(), len(self._text)))

    def handle_endtag(self, tag):
        opened, classes, begin = self._open.pop()
        assert opened == tag
        text = " ".join(self._text[begin:].split())
        for name in classes:
            self.classes.setdefault(name, []).append(text)
        if tag in ("h1", "h2", "h3", "h4"):
            self.headings.append((int(tag[1]), text))
        elif tag in ("td", "th"):
            self._cells.append(text)
        elif tag == "tr" and any(own == "tbody" for own, *_ in self._open):
            self._rows.append(self._cells)

    def handle_data(self, data):
        if not any(tag == "style" for tag, *_ in self._open):
            self._text += data

    @property
    def outline(self):
        """Headings and tables, the verdict in a sentence, and the sentence on what the last model leaves."""
        lines = [f"{'#' * level} {text}" for level, text in self.headings]
        said = [*self.classes["verdict"], *self.classes.get("left", [])]
        return "\n".join([*lines, f"tables: {', '.join(self.tables)}", *said])
