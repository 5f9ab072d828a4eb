"""A finding is data, declared in one place, and its text is made in one place."""

import copy
import json
import pickle

import pytest

import ambid
from ambid.findings import KINDS, NOWHERE, Kind, Where, has

LATE = Kind(
    "test_channel_late",
    "warning",
    "{channels} read {delay_s:.3g|us} late[, {samples:.2f} of a sample]; see [controller]",
    "shift {channels} by {delay_s:.3g} s",
)
"""All that a new finding takes: this declaration, in the room that makes it."""


def test_a_finding_takes_one_declaration():
    found = LATE(Where(record="run_1", channel="y"), channels=["y.A", "y.B"], delay_s=41e-6)
    assert found.as_dict() == {
        "code": "test_channel_late",
        "severity": "warning",
        "where": {"file": None, "record": "run_1", "channel": "y", "axis": None, "key": None},
        "values": {"channels": ["y.A", "y.B"], "delay_s": 41e-6},
        "message": "y.A, y.B read 41 us late; see [controller]",
        "remedy": "shift y.A, y.B by 4.1e-05 s",
    }
    assert found.line() == f"run_1, y: {found.message}; {found.remedy}"
    assert has([found], LATE)
    assert KINDS["test_channel_late"] is LATE


def test_what_has_no_value_is_left_out_of_the_text():
    known = LATE(NOWHERE, channels=["y.A"], delay_s=41e-6, samples=0.41)
    assert known.message == "y.A read 41 us late, 0.41 of a sample; see [controller]"
    assert LATE(NOWHERE, channels=["y.A"], delay_s=41e-6, samples=None).message.count(",") == 0


def test_braces_and_brackets_of_values_are_no_template():
    text = "{channels} [of] {0}"
    assert LATE(NOWHERE, channels=[text], delay_s=0.0).message.startswith(text)


def test_two_kinds_cannot_share_a_code():
    with pytest.raises(ValueError, match="test_channel_late"):
        Kind("test_channel_late", "note", "something else")


def test_the_severity_may_hang_on_the_values():
    assert LATE(NOWHERE, severity="error", channels=[], delay_s=1.0).severity == "error"


def test_findings_are_copied_pickled_and_compared():
    found = LATE(Where(record="run"), channels=["y.A"], delay_s=1e-3)
    for again in (copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert again == found
        assert hash(again) == hash(found)
    with pytest.raises(TypeError):
        found.values["delay_s"] = 0.0


def test_values_that_are_no_numbers_are_null_in_json():
    assert json.loads(json.dumps(LATE(NOWHERE, channels=[], delay_s=float("nan")).as_dict(), allow_nan=False))


def test_it_is_a_public_name():
    assert ambid.Finding is type(LATE(NOWHERE, channels=[], delay_s=0.0))


def test_values_by_name_are_written_with_their_names():
    factors = {"i_e": 0.7692, "proportional": {"A_zeta": 0.9, "B_eta": 1.25}}
    found = Kind("test_factors", "warning", "{factors:.3g}")(factors=factors)
    assert found.message == "i_e 0.769, proportional (A_zeta 0.9, B_eta 1.25)"
    assert found.as_dict()["values"] == {"factors": factors}
