"""What is promised of a command to which a signal came at any moment."""

from collections import Counter

CODES = {"SIGINT": 130, "SIGTERM": 143}


def check(found, all_or_none=True):
    """Hold every run against what is promised; returns how often which signal left the files in which states."""
    for one in found:
        states, name = set(one["files"].values()), one["signal"]
        assert "broken" not in states, one
        assert "Traceback" not in one["err"], one["err"]
        if name == "SIGKILL":
            assert one["left_over"] <= 1
            continue
        assert one["left_over"] == 0
        if not name:
            assert (one["code"], states) == (0, {"new"}), one["err"]
        else:
            assert one["code"] in (0, CODES[name]), one
        if one["code"] == 0:
            assert states == {"new"}
        if all_or_none:
            assert len(states) == 1, "one signal: all files are written, or none"
    return Counter((one["signal"], *sorted(set(one["files"].values()))) for one in found)
