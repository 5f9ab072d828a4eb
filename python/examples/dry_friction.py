"""Physics that the catalogue has no name for: the shape of the force that is missing becomes an effect itself."""

import numpy as np
from scipy.integrate import odeint

import ambid
from ambid.effects import MeasuredShape

rig = ambid.Rig.from_toml(
    """name = "levitator"
sample_rate = 10000.0
rotor = { kind = "mass", mass = 12.0 }
amplifier = { time_constant = 1e-4 }
actuator = { time_constant = 3e-4 }
bearing = [{ name = "A", axes = ["zeta"], position = 0.0, sensor_position = 0.0, bias_current = 4.0, air_gap = 0.0006,
  force_current = 180.0, force_displacement = 1.2e6 }]
controller = { kind = "pid", implementation = "analog", proportional = 15000.0, integral = 300000.0, derivative = 45.0,
  derivative_time_constant = 1e-4 }
""".replace(",\n  ", ", ")
)


def measured(amplitude, seed):
    """The machine, integrated by SciPy: dry friction of 3 N holds the mass."""
    random, i_e = np.random.default_rng(seed), ambid.prbs(8, amplitude=amplitude, hold=4, periods=4)

    def rates(x, _, command, late):
        s, v, i_c, i_f, total, slow = x
        i_ref = command - 15000.0 * (s + late) - 300000.0 * total - 45.0 * (s + late - slow) / 1e-4
        force = 185.0 * i_f + 1.18e6 * s - 3.0 * np.tanh(v / 1e-3)
        return v, force / 12.0, (i_ref - i_c) / 1e-4, (i_c - i_f) / 2.85e-4, s + late, (s + late - slow) / 1e-4

    x, signals = np.zeros(6), []
    for command in i_e[:, 0]:
        late = 3e-7 * random.standard_normal()
        signals.append((x[0] + late, x[2] + 5e-3 * random.standard_normal()))
        x = odeint(rates, x, (0.0, 1e-4), args=(command, late), rtol=1e-8, atol=1e-12)[1]
    y, i_c = np.array(signals).T[:, :, None]
    return ambid.Record.from_arrays(y=y, i_c=i_c, i_e=i_e, sample_rate=1e4, axes=rig.axes, rig=rig)


train, other = measured(1.0, 1), measured(0.8, 2)
nameless = [effect for effect in ambid.CATALOGUE if effect.name != "coulomb_friction"]  # as if nobody had thought of it
found = ambid.diagnose(rig, train, validate=[other], catalogue=nameless)
print(f"{found.verdict}: {found.notes[-1]}")

model, shape = found.fit.model, None
for _ in range(3):  # each takes out of the shape what the parameters of the model had taken up of it
    force = next(port for port in ambid.localise(ambid.compare(model, train)).ports if port.name == "force")
    shape = MeasuredShape.from_port(force, before=shape)
    model = ambid.identify(found.fit.model.add(shape), train).model
    shape = shape.times(model.theta[-1])
misfits = [ambid.compare(model, record).misfit for record in (train, other)]
print(f"measured force over {shape.over}: misfit {misfits[0]:.2f}, of the other record {misfits[1]:.2f}")
for at, value in zip(shape.at, shape.values, strict=True):
    print(f"{1e3 * at:8.2f} mm/s {value:7.2f} N")
