"""What tests do not do: hang on phrases of English, reach into what is private, or judge by a clock."""

import ast

import pytest

from places import TESTS
from source import clocks, foreign, phrases, sources

PHRASES = 18
"""Assertions on a text by its words, outside of golden files: labels and headings. It may fall."""
TREES = {str(path.relative_to(TESTS)): tree for path, tree in sources(TESTS, without="benchmarks")}


def found(look, trees=TREES):
    """Places of what is looked for."""
    return [f"{name}:{line}: {text}" for name, tree in trees.items() for line, text in look(tree)]


def test_few_assertions_hang_on_phrases():
    """Ask for a code, a value or a name; where the text is the claim, for `golden.holds`."""
    places = found(phrases)
    assert len(places) <= PHRASES, "\n".join(places)


def test_nothing_private_is_imported_nothing_taken_from_benchmarks_and_no_interface_faked():
    assert found(foreign) == []


def test_nothing_passes_or_fails_by_a_clock():
    assert found(clocks) == []


@pytest.mark.parametrize(
    ("look", "source", "count"),
    [
        (phrases, "assert 'the loop is unstable' in said", 1),
        (phrases, "assert said.startswith(f'{name}: the loop is')", 1),
        (phrases, "with pytest.raises(ValueError, match=r'no\\ period'): pass", 1),
        (phrases, "assert finding.code == 'channel_delay' and run('check', 'it is fine') == 0", 0),
        (phrases, "assert result['all of it'].values == {'delay_s': 1e-4}", 0),
        (foreign, "from ambid.record.local_response import _noise", 1),
        (foreign, "from benchmarks.null_cells import made", 1),
        (foreign, "from types import SimpleNamespace", 1),
        (foreign, "assert part._judged", 1),
        (foreign, "from ambid import _core\nfrom __future__ import annotations\nself._own", 0),
        (clocks, "def test():\n begun = time.monotonic()\n work()\n assert time.monotonic() - begun < 1.0", 1),
        (clocks, "def test():\n begun = process_time()\n took = process_time() - begun\n assert took < 1.0", 1),
        (clocks, "def test():\n begun = time.time()\n assert evaluations < 100", 0),
    ],
)
def test_what_is_looked_for_is_seen(look, source, count):
    assert len(list(look(ast.parse(source)))) == count
