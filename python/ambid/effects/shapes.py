"""What has no name but a shape: effects of the catalogue are held against it, and it is never named.

A smooth law and one with a corner, such as a stop, can look alike in what is left of a model that has neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from ambid.effects.places import size_of_stiffness
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant
from ambid.rig import Rig


@dataclass(frozen=True)
class SmoothSpring(Effect):
    """A force at every magnet that grows with the cube of the displacement: the first odd term of any smooth one."""

    name = "smooth_spring"
    physics = "a force at the magnets that is not linear in the displacement, and smooth"
    equation = "F = c s^3"
    signature = "odd; grows with the cube of the motion"
    source = "Nayfeh, Mook, Nonlinear Oscillations, 1979, chapter 2"

    def parameters(self, rig: Rig) -> Sequence[EffectParameter]:
        """The cubic stiffness [N/m^3], of which a hundredth of K_s at the gap is small."""
        gap = min(bearing.air_gap for bearing in rig.bearings)
        probe = 0.01 * size_of_stiffness(rig) / gap**2
        return [EffectParameter("cubic", "N/m^3", probe, lower=-float("inf"), meaning="cubic stiffness c")]

    def attach(self, plant: Plant) -> None:
        """At every magnet."""
        for axis in plant.axes:
            bent = plant.block("polynomial", [plant.raw(f"s.{axis}")], {"c0": self.slot("cubic")}, exponents=[[3]])
            plant.inject(f"f.{axis}", bent)


SHAPES: tuple[Effect, ...] = (SmoothSpring(),)
