"""What effects of one family share: the numbers on which records that cannot distinguish them still agree."""

from ambid.loop.effect import Trait

LAG_OF_CURRENT = Trait("a lag", "between command and coil current", "s", "a lead")
LAG_OF_READING = Trait("a lag", "between coil current and displacement reading", "s", "a lead")
LAG_ROUND_LOOP = Trait("a lag", "round the loop", "s")
GAIN_OF_ANSWER = Trait("a gain", "from excitation to what answers it", "1")
GAIN_OF_READING = Trait("an error", "of what single displacement sensors read", "1")
STIFFNESS = Trait("a stiffness", "to ground, beside the magnets", "N/m")
DAMPING = Trait("a damping", "to ground, beside the magnets", "N s/m")
CURVATURE = Trait("a curvature", "of the force over current and gap", "1")
RESONANCE = Trait("a resonance", "beside those of the base model", "Hz")
