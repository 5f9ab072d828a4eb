"""The face of the package: every public name is there, and nothing is loaded before it is used."""

import subprocess
import sys

import pytest

import ambid

LATE = ("scipy", "pydantic", "matplotlib", "jinja2")


@pytest.mark.parametrize("name", ambid.__all__)
def test_every_name_is_there(name):
    found = getattr(ambid, name)
    assert found.__doc__, name
    assert name in dir(ambid)


def test_a_name_that_is_not_there_is_refused():
    with pytest.raises(AttributeError, match="identfy"):
        _ = ambid.identfy


@pytest.mark.parametrize(
    "program",
    [
        "import ambid",
        "import ambid.cli.options",
        "import sys; sys.argv = ['ambid', '--help']; import ambid.cli.app as c; c.app(standalone_mode=False)",
    ],
    ids=["import", "options", "help"],
)
def test_what_is_slow_to_load_is_loaded_when_it_is_used(program):
    shown = f"{program}\nimport sys\nprint([name for name in {LATE} if name in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", shown], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines()[-1] == "[]"
