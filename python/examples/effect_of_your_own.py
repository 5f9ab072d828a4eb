"""An effect of your own, ranked beside the catalogue: touch-down bearings that centre the rotor with a cubic force."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import ambid
from ambid.demo import DATA
from ambid.effects import CATALOGUE, Effect, EffectParameter


class Hardening(Effect):
    """The parameter c is zero in the base model; settings, if it had any, would be fields of a frozen dataclass."""

    name = "hardening"
    physics = "touch-down bearings that centre the rotor with a cubic force"
    equation = "F = -c s^3 at each magnet"
    signature = "odd, grows with the cube of the displacement"
    source = "the user's own idea"

    def parameters(self, rig):
        """Name, unit, a typical value and what it means; bounds may be added."""
        return [EffectParameter("cubic", "N/m^3", 1e12, meaning="force c over the cube of the displacement")]

    def attach(self, plant):
        """Any function of signals of the plant; it is tabulated and runs in the core."""
        for axis in plant.axes:
            force = plant.table(lambda s: -(s**3), [plant[f"s.{axis}"]], reach=[5e-5], slot=self.slot("cubic"))
            plant.inject(f"f.{axis}", force)


# A virtual experiment of a machine that has the effect, with noise.
rig = ambid.Rig.load(DATA / "rig.toml")
machine = ambid.Model(rig).add(Hardening(), {"cubic": 5e14})
excitation = ambid.prbs(7, amplitude=0.8, hold=5, axes=4, periods=4)
record = replace(machine.virtual_experiment(excitation, seed=1), period=len(excitation) // 4)
print(f"largest displacement {1e6 * abs(record.y).max():.0f} um")

# Does the residual of the base model ask for it, rather than for one of the catalogue?
estimate = ambid.identify(rig, record)
ranking = ambid.rank(ambid.compare(estimate.model, record), [*CATALOGUE, Hardening()])
print(f"misfit {ranking.misfit:.2f}")
for candidate in ranking.candidates[:3]:
    print(f"{candidate.effect.name:20s} would leave {candidate.predicted_misfit:.2f}")

best = ranking.candidates[0]
better = ambid.identify(estimate.model.add(best.effect, best.start), record)
cubic = better.parameters["hardening.cubic"]
print(f"{best.effect.name}: cubic {cubic.value:.3g} +- {cubic.std_error:.1g} {cubic.unit}; 5e14 was put in")
left = ambid.compare(better.model, record).records[0].misfit
print(f"with it the misfit falls to {left:.2f}; 1 is noise alone")

# A file names the effect; the catalogue that has it makes a model of the file again.
with TemporaryDirectory() as folder:
    better.model.save(Path(folder) / "model.json")
    again = ambid.Model.load(Path(folder) / "model.json", catalogue=[*CATALOGUE, Hardening()])
print(f"loaded again with {again.effects[0].name}")
