"""Models for programs without Python: the file of the stepper in C, and functional mock-up units."""

from ambid.embedded.unit import to_fmu, to_stepper

__all__ = ["to_fmu", "to_stepper"]
