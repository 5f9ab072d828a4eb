"""A mass on one axis, of which a diagnosis takes some tenths of a second, and what is hidden in it."""

from collections.abc import Mapping

from ambid.record import Record
from ambid.rig import Rig
from places import LEVITATOR

from .bench import measured
from .families import Bench

ONE_AXIS = Bench(
    rig=Rig.load(LEVITATOR),
    K_i=(185.0,),
    K_s=(1.18e6,),
    tau_e=2.85e-4,
    hold=4,
    periods=4,
    amplitude=1.0,
    middle=0.0,
    order=9,
)
NAMED = {
    "external_damping": {"rate": 60.0},
    "coulomb_friction": {"force": 0.25, "z": ONE_AXIS.middle},
    "rotor_contact": {"stiffness": 3e5, "damping": 10.0, "clearance": 1e-5},
    "foundation_resonance": {"frequency_hz": 170.0, "damping": 0.04, "mass_kg": 100.0},
    "force_nonlinearity": {"share": 1.0},
    "flux_saturation": {"level": 0.75, "curve": "blend"},
    "eddy_currents": {"tau": 3e-6},
    "magnetic_hysteresis": {"share": 0.1, "width": 0.4},
    "amplifier_bandwidth": {"frequency_hz": 1500.0, "damping": 0.7},
    "amplifier_voltage_limit": {"slew": 4e3},
    "loop_delay": {"seconds": 5e-5},
    "sensor_lag": {"tau": 3e-5},
    "sampling_skew": {"seconds": 2e-5},
    "sensor_nonlinearity": {"quadratic": 300.0, "cubic": 3e6},
    "bias_asymmetry": {"bias": 0.05},
    "command_saturation": {"level": 2.0},
    "back_emf": {"coefficient": 1.0},
    "periodic_disturbance": {"frequency_hz": 50.0, "amplitude": 0.02, "port": "current"},
}
"""Of these the catalogue has the name."""
NAMELESS = {
    "cubic_bearing_force": {"coefficient": 1e15},
    "amplifier_dead_band": {"current": 0.001},
    "amplifier_asymmetry": {"fraction": 0.05},
    "rate_softening": {"knee": 1e6},
}
"""Of these it has none."""


def record(hidden: Mapping[str, Mapping[str, object]], seed: int, share: float = 1.0) -> Record:
    """A record of the mass, at a share of its excitation."""
    return measured(ONE_AXIS.rig, ONE_AXIS.excitation(share * ONE_AXIS.amplitude), hidden, seed=seed, **ONE_AXIS.truth)
