"""What can go wrong, one class per cause that a user can act on, and text that is safe to show."""

import re
import unicodedata
from collections.abc import Iterable

LONGEST_MESSAGE = 2000
"""Characters of a message: about a screen. What is left out is of no help to a reader, and may be megabytes."""
LAST_PART = 500
"""Characters of these that are kept for the end, where it says what to do."""
_UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Zl", "Zp"})
"""Categories of Unicode that steer a terminal, turn the direction of text, or cannot be encoded."""


def printable(text: str) -> str:
    """Text with its line breaks and tabs; other control characters, such as those of escapes, are spelled out.

    Names come from files of others: they must not steer a terminal, nor break a picture or a page.
    """
    return re.sub(r"[^\n\t -~]", lambda found: _spelled(found[0]), text)


def _spelled(c: str) -> str:
    return c.encode("unicode_escape").decode() if unicodedata.category(c) in _UNSEEN else c


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """A sentence that names what comes nearest, with a space behind it; empty where nothing is near.

    The same letters come first, whatever their case and what stands between them; then what holds all of them.
    """
    from difflib import get_close_matches  # not at the top: it is needed for errors alone

    own, letters = _letters(name), {each: _letters(each) for each in known}
    near = [each for each, its in letters.items() if its == own and own][:1]
    if not near and len(own) >= 4:  # letters of a name that say something of it: fewer are in too many
        near = [each for each, its in letters.items() if own in its][:4]
    if not near and (close := get_close_matches(own, letters.values(), n=1)):
        near = [next(each for each, its in letters.items() if its == close[0])]
    if not near:
        return ""
    *others, last = near
    return f"did you mean {', '.join(others)}{' or ' if others else ''}{last}? "


def _letters(name: str) -> str:
    return "".join(filter(str.isalnum, name)).casefold()


class AmbidError(Exception):
    """Base of every error that ambid raises on purpose; its message is printable, and a screen long at most."""

    def __init__(self, message: str) -> None:
        text = printable(message)  # before it is cut: what is spelled out is up to ten times as long
        more = len(text) - LONGEST_MESSAGE
        if more > 0:
            text = f"{text[: LONGEST_MESSAGE - LAST_PART]} ... ({more} characters left out) ... {text[-LAST_PART:]}"
        super().__init__(text)


class InputError(AmbidError):
    """Something the user gave is wrong; the message names it, its value, and what is allowed."""


class RigError(InputError):
    """A rig file or rig object is wrong: names the key, the value found and what is allowed."""


class RecordError(InputError):
    """A record is wrong: names the file, the channel, the value found and what to do."""


class ModelError(InputError):
    """A request on a model is wrong: an unknown parameter, a start outside its bounds, a wrong shape."""


class UnknownParameterError(ModelError, KeyError):
    """A parameter was asked for by a name that is none."""

    __str__ = Exception.__str__  # that of a KeyError has quotes


class OutputError(AmbidError):
    """A file could not be written: names it, the reason, such as a full disk, and what to do."""


class WrongUnit(RecordError):
    """A record's values are so large that they look like another unit.

    Attributes
    ----------
    problem : str
        Channel, value and what is allowed, without a guess at the cause.
    """

    def __init__(self, where: str, problem: str, advice: str) -> None:
        super().__init__(f"{where}: {problem}: {advice}")
        self.problem = problem


class UnstableLoopError(AmbidError):
    """The simulated closed loop is unstable, so that it has no response to compare."""


class UnstableStartError(UnstableLoopError):
    """A fit has found no start with a stable loop; the message says what was tried."""


class Stopped(KeyboardInterrupt):
    """Ctrl-C during a job that had something to show: passes on like any KeyboardInterrupt.

    Attributes
    ----------
    result : object
        What was done before, such as an `Estimate` or a `Diagnosis`, marked as stopped.
    """

    def __init__(self, result: object) -> None:
        super().__init__("stopped by Ctrl-C")
        self.result = result


class IdentificationError(AmbidError):
    """The data and the model were accepted, but the job could not be done."""


class Cancelled(AmbidError):
    """A person has ended a job of the workbench; its result is dropped."""


class StaleWindow(AmbidError):
    """A window of the workbench shows a step that is no longer the last, or a job is running: nothing is changed."""
