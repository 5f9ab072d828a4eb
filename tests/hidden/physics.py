"""What can hide in a record: the effects of the catalogue and physics outside it, with their parameters."""

from collections.abc import Mapping

NEEDED = object()
"""Stands for a parameter without a default."""

CATALOGUE: dict[str, dict[str, tuple[object, str]]] = {
    "rotor_bending_mode": {
        "count": (1, "bending modes per plane that the rotor has beyond those of the rig file"),
        "participation": (1.0, "factor on the shapes of these modes, 0 to 1"),
    },
    "bending_mode_shift": {
        "frequency_factor": (1.0, "true over known frequency"),
        "damping": (None, "true damping ratio; None: as known"),
        "mode": (0, "which bending mode, from 0"),
    },
    "rotor_inertia_error": {
        "mass_factor": (1.0, "true over known mass"),
        "inertia_factor": (1.0, "true over known transverse inertia"),
    },
    "gyroscopic_coupling": {"factor": (NEEDED, "true over known gyroscopic matrix; acts at speed")},
    "unbalance": {
        "mass_eccentricity": (NEEDED, "kg m"),
        "z": (NEEDED, "m"),
        "phase": (0.0, "rad at t = 0, from global x"),
    },
    "seal_forces": {
        "z": (NEEDED, "m"),
        "direct": (0.0, "N/m, centring"),
        "cross": (0.0, "N/m, drives forward whirl: F_x = -cross u_y, F_y = cross u_x"),
        "damping": (0.0, "N s/m"),
        "cross_damping": (0.0, "N s/m: F_x = -cross_damping u_y', F_y = cross_damping u_x'"),
    },
    "coupling_stiffness": {
        "stiffness": (NEEDED, "N/m to ground"),
        "damping": (0.0, "N s/m to ground"),
        "z": (None, "m; None: the end of the shaft"),
    },
    "external_damping": {
        "rate": (0.0, "1/s, of the whole rotor times its mass matrix"),
        "damping": (0.0, "N s/m, at z"),
        "z": (0.0, "m"),
    },
    "internal_damping": {"damping": (NEEDED, "N s/m, as seen from the rotor"), "z": (NEEDED, "m")},
    "magnetic_pull": {"stiffness": (NEEDED, "N/m, away from the centre"), "z": (NEEDED, "m")},
    "foundation_resonance": {
        "frequency_hz": (NEEDED, "of the housing alone on its support"),
        "damping": (0.05, "ratio"),
        "mass_kg": (NEEDED, "of the housing that carries magnet and sensors"),
        "bearing": (None, "name; None: every bearing has such a housing"),
    },
    "force_nonlinearity": {"share": (1.0, "of what the square law adds to the linear force, 0 to 1")},
    "flux_saturation": {
        "level": (NEEDED, "linear flux density at bias over saturation flux density"),
        "curve": ("blend", "'blend' (Langevin's curve and a sharp knee) or 'tanh'"),
    },
    "eddy_currents": {"tau": (NEEDED, "s of 1 / (1 + sqrt(tau s)), in series with tau_e")},
    "magnetic_hysteresis": {
        "share": (NEEDED, "of the current that a hysteresis carries, 0 to 1"),
        "width": (0.5, "A, half-width of the widest play operator"),
    },
    "axis_cross_coupling": {"fraction": (NEEDED, "of K_i i of the other axis of the bearing")},
    "amplifier_bandwidth": {
        "frequency_hz": (None, "second order; or"),
        "damping": (0.7, "its ratio"),
        "time_constant": (None, "s, first order but another one than known"),
    },
    "amplifier_voltage_limit": {"slew": (NEEDED, "A/s")},
    "command_saturation": {"level": (NEEDED, "A, of the command")},
    "loop_delay": {"seconds": (NEEDED, "s, exact")},
    "sensor_lag": {"tau": (NEEDED, "s")},
    "sensor_gain_error": {"gain": (NEEDED, "true over nominal, a number or one per axis")},
    "sensor_misalignment": {"degrees": (NEEDED, "a number or one per bearing, from zeta to eta")},
    "sensor_position_error": {"dz": (NEEDED, "m, a number or one per bearing")},
    "sampling_skew": {"seconds": (NEEDED, "s by which i_c is read after y, negative before")},
    "sensor_nonlinearity": {"quadratic": (0.0, "1/m"), "cubic": (0.0, "1/m^2")},
    "bias_asymmetry": {"bias": (NEEDED, "of opposed magnets, half their difference over their mean")},
    "sensor_runout": {
        "amplitude": (NEEDED, "m, a number or one per axis"),
        "harmonic": (1, "times the frequency of rotation"),
        "phase": (0.0, "rad at t = 0"),
    },
    "back_emf": {"coefficient": (NEEDED, "A s/m: drop of the amplifier's drive per velocity towards the magnet")},
    "inductance_error": {
        "error": (0.0, "relative, of the inductance at rest"),
        "gap_part": (0.0, "part of the reluctance that lies in the gap"),
    },
    "periodic_disturbance": {
        "frequency_hz": (NEEDED, "Hz"),
        "amplitude": (NEEDED, "N or A"),
        "port": ("current", "'force' at the magnet, or 'current' into the amplifier"),
        "axis": (0, "index of the axis; None: all"),
        "phase": (0.0, "rad at t = 0"),
    },
    "rotor_contact": {
        "stiffness": (NEEDED, "N/m"),
        "clearance": (NEEDED, "m, all round"),
        "damping": (0.0, "s/m: by how much the stiffness grows with the speed of approach"),
        "z": (None, "m; None: at every magnet"),
    },
    "coulomb_friction": {
        "force": (NEEDED, "N"),
        "stiffness": (2e7, "N/m before it slips"),
        "dahl": (False, "whether it begins to slip gradually, as by Dahl, in place of a slider on a spring"),
        "z": (None, "m; None: at every magnet"),
    },
}

OUTSIDE: dict[str, dict[str, tuple[object, str]]] = {
    "cubic_bearing_force": {"coefficient": (NEEDED, "N/m^3, centring, at every axis")},
    "amplifier_dead_band": {"current": (NEEDED, "A, half-width")},
    "amplifier_asymmetry": {"fraction": (NEEDED, "current that is wanted positive comes out larger, negative smaller")},
    "command_quantisation": {"step": (NEEDED, "A")},
    "rotor_anisotropy": {"frequency_factor": (NEEDED, "bending frequencies in y over those in x")},
    "force_current_drift": {"fraction": (NEEDED, "change of K_i over the record")},
    "parametric_stiffness": {"stiffness": (NEEDED, "N/m, amplitude"), "frequency_hz": (3.7, "Hz")},
    "rate_softening": {"knee": (NEEDED, "A/s at which the force current moves at half its linear rate")},
}


def settle(hidden: Mapping[str, Mapping[str, object]]) -> dict[str, dict]:
    """Check the names of effects and parameters, and fill in the defaults.

    Raises
    ------
    ValueError
        For an unknown effect or parameter, or a parameter that is missing.
    """
    settled = {}
    for effect, given in hidden.items():
        known = CATALOGUE.get(effect) or OUTSIDE.get(effect)
        if known is None:
            raise ValueError(f"{effect}: no such effect; there are {', '.join([*CATALOGUE, *OUTSIDE])}")
        if unknown := set(given) - set(known):
            raise ValueError(f"{effect} has no parameter {', '.join(sorted(unknown))}; it has {', '.join(known)}")
        values = {name: given.get(name, default) for name, (default, _) in known.items()}
        if missing := [name for name, value in values.items() if value is NEEDED]:
            raise ValueError(f"{effect} needs a value of {', '.join(missing)}")
        settled[effect] = values
    return settled
