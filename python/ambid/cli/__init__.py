"""The command `ambid`: each subcommand reads files, does one job, writes what it is asked for, and prints tables."""

from __future__ import annotations

import sys

from ambid.cli import signals, streams
from ambid.errors import AmbidError, InputError, printable

__all__ = ["main"]


def main() -> None:
    """Entry point; the exit codes are explained under Results in the documents."""
    signals.watch()
    streams.protect()
    try:
        code = streams.finish(_run())
    except KeyboardInterrupt:
        code = signals.exit_code()
    sys.exit(signals.finish(code))


def _run() -> int:
    """Exit code of the command; what is slow to import is imported here, where a signal ends in order."""
    try:
        from ambid.cli.app import command

        command()()
    except SystemExit as ended:
        return int(ended.code or 0)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except AmbidError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except MemoryError:
        print("error: this needs more memory than there is; give shorter or fewer records", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"error: {printable(str(error.filename))}: {error.strerror}", file=sys.stderr)
        return 2
    return 0
