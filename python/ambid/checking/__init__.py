"""Slips of people in a rig file and its records, found before any fit."""

from ambid.checking.instants import CURRENT_AHEAD, CURRENT_BEHIND
from ambid.checking.machine import FORCE_TOO_SMALL
from ambid.checking.path import OPERATING_POINT_DRIFT
from ambid.checking.slips import check, stops_diagnosis
from ambid.checking.soundness import LoopFigures, RecordFigures, ResponseFigures, Soundness

__all__ = [
    "CURRENT_AHEAD",
    "CURRENT_BEHIND",
    "FORCE_TOO_SMALL",
    "OPERATING_POINT_DRIFT",
    "LoopFigures",
    "RecordFigures",
    "ResponseFigures",
    "Soundness",
    "check",
    "stops_diagnosis",
]
