"""Commands that are written down somewhere, read by the command's own parser, which runs none of them."""

from collections.abc import Sequence

from typer.main import get_command

from ambid.cli.app import app

COMMANDS = get_command(app).commands


def read_by_the_command_line(words: Sequence[str]) -> dict[str, object]:
    """The parameters that the words of one ``ambid ...`` give; an error of click where it would refuse them."""
    program, name, *rest = words
    assert program == "ambid"
    return COMMANDS[name].make_context(name, rest).params
