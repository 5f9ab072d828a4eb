"""Slips of people in a rig file and its records, found before any fit."""

from ambid.checking.slips import check
from ambid.checking.soundness import Finding, LoopFigures, RecordFigures, Soundness

__all__ = ["Finding", "LoopFigures", "RecordFigures", "Soundness", "check"]
