"""The physics of a machine with hidden effects, stage by stage along the loop.

rotor and housings -> sensors -> controller -> command -> amplifiers -> flux -> force -> rotor. Without effects this is
``M q'' + speed G q' + K q = f``, ``tau_a i_c' = i_ref - i_c``, ``tau_e i_f' = i_c - i_f``, ``f = K_i i_f + K_s s`` and
``i_ref = -(K y) + i_e``, written in global x and y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from scipy.linalg import block_diag

from ambid.rig import Rig

from .laws import half_order, magnet
from .network import CAPACITY, Network
from .rotor import TrueRotor


@dataclass(frozen=True)
class Machine:
    """Network of a rig with its hidden effects.

    Attributes
    ----------
    network : Network
    outputs : ndarray, shape (2 axes and further channels, CAPACITY)
        y then i_c as they are read at each sample, then the further channels.
    late : int
        By how many rows each row of i_c comes after that of y which it belongs to.
    """

    network: Network
    outputs: np.ndarray
    late: int


def build(
    rig: Rig,
    hidden: dict[str, dict],
    *,
    K_i: np.ndarray,
    K_s: np.ndarray,
    tau_e: np.ndarray,
    flexible_modes: int | None,
    gravity: float,
    load: tuple[float, float, float],
    before: float,
    seconds: float,
    adc_step: float = 0.0,
    further: Sequence[str] = (),
) -> Machine:
    """Lay out the machine; parameters as in `bench.simulate`, `before` is the time from its start to t = 0 [s]."""
    return _Builder(rig, hidden, K_i, K_s, tau_e, before, seconds, adc_step).build(
        TrueRotor(rig, hidden, flexible_modes), gravity, load, further
    )


class _Builder:
    def __init__(self, rig, hidden, K_i, K_s, tau_e, before, seconds, adc_step) -> None:
        self.rig, self.hidden = rig, hidden
        self.K_i, self.K_s, self.tau_e = K_i, K_s, tau_e
        self.before, self.seconds, self.adc_step = before, seconds, adc_step
        self.n = len(rig.axes)
        self.of_bearing = [k for k, bearing in enumerate(rig.bearings) for _ in bearing.axes]
        self.net = Network()
        self.i_e, self.noise = self.net.inputs(self.n), self.net.inputs(self.n)
        self.held = self.net.inputs(self.n if rig.controller.is_digital else 0)

    def build(
        self, rotor: TrueRotor, gravity: float, load: tuple[float, float, float], further: Sequence[str]
    ) -> Machine:
        net, n = self.net, self.n
        self.rotor = rotor
        self.planes = rotor.planes
        self.q, self.v = (net.states(np.zeros(len(rotor.squares))) for _ in range(2))
        self.push = np.zeros((len(rotor.squares), CAPACITY))  # modal forces
        self._housings()
        places = [b.position for b in self.rig.bearings for _ in b.axes]
        s, s_rate = (self._along_axes(places, of) for of in ((self.q, self.house), (self.v, self.house_rate)))
        y = self._sensors()
        command = self._command(y)
        i_c, out = self._amplifiers(command, s, s_rate)
        self.i_c, self.s_rate = i_c, s_rate
        i_f = self._flux(i_c)
        force = self._force(i_f, s, s_rate)
        for k in range(n):
            direction = self._directions[k]
            self.push += rotor.at(places[k]).T @ direction[:, None] @ force[[k]]
            self.house_push[self.of_bearing[k]] -= direction[:, None] @ force[[k]]
        self._surroundings(gravity, load)
        net.rate(self.q, self.v)
        moving = np.diag(rotor.damping) + self.rig.speed * rotor.gyroscopic
        acceleration = self.push - np.diag(rotor.squares) @ self.q - moving @ self.v
        net.rate(self.v, acceleration)
        self._support()
        read = dict(zip((f"f.{axis}" for axis in self.rig.axes), force, strict=True))
        if self.rig.amplifier.resistance or self.rig.amplifier.coil_resistance:
            voltage = command if self.rig.amplifier.resistance else self._voltage()
            read |= dict(zip((f"u.{axis}" for axis in self.rig.axes), voltage, strict=True))
        if any(name.startswith("b.") for name in further):
            read |= dict(zip((f"b.{axis}" for axis in self.rig.axes), self._hall(i_f, s), strict=True))
        for sensor in self.rig.sensors:
            angle = np.deg2rad(sensor.direction)
            along = np.array([np.cos(angle), np.sin(angle)]) if self.planes == 2 else np.ones(1)
            if sensor.housing is None:
                moved = rotor.at(sensor.z) @ (acceleration if sensor.signal == "a" else self.q)
            else:
                of = [bearing.name for bearing in self.rig.bearings].index(sensor.housing)
                moved = self.house_acceleration[of] if sensor.signal == "a" else self.house[of]
            read[sensor.channel] = along @ moved
        beyond = [read[name][None] for name in further]
        skew = self.hidden.get("sampling_skew", {"seconds": 0.0})["seconds"]
        late = ceil(skew * self.rig.sample_rate - 1e-9)
        return Machine(net, np.concatenate([y, out, *beyond]), late)

    # Motion -----------------------------------------------------------------------------------------------------------

    @property
    def _directions(self) -> np.ndarray:
        """Unit vector of each axis, shape (axes, planes)."""
        if self.planes == 1:
            return np.ones((self.n, 1))
        angles = [b.tilt + {"zeta": 0.0, "eta": 90.0}[a] for b in self.rig.bearings for a in b.axes]
        return np.column_stack([np.cos(np.deg2rad(angles)), np.sin(np.deg2rad(angles))])

    def _along_axes(self, places, of) -> np.ndarray:
        """Displacement (or rate) of the rotor at one z per axis against the housings, along the axes."""
        modal, house = of
        rows = [
            self._directions[[k]] @ (self.rotor.at(z) @ modal - house[self.of_bearing[k]]) for k, z in enumerate(places)
        ]
        return np.concatenate(rows)

    def _housings(self) -> None:
        """Displacement and rate of the housing of each bearing, (planes, CAPACITY); zero where it is rigid."""
        still = np.zeros((self.planes, CAPACITY))
        self.house, self.house_rate, self.house_push = [], [], []
        for bearing in self.rig.bearings:
            moves = "foundation_resonance" in self.hidden
            moves = moves and self.hidden["foundation_resonance"]["bearing"] in (None, bearing.name)
            self.house.append(self.net.states(np.zeros(self.planes)) if moves else still)
            self.house_rate.append(self.net.states(np.zeros(self.planes)) if moves else still)
            self.house_push.append(still.copy())

    def _support(self) -> None:
        self.house_acceleration = [np.zeros_like(house) for house in self.house]
        for k, (house, rate, push) in enumerate(zip(self.house, self.house_rate, self.house_push, strict=True)):
            if house.any():
                support = self.hidden["foundation_resonance"]
                omega = 2.0 * np.pi * support["frequency_hz"]
                self.net.rate(house, rate)
                back = omega**2 * house + 2.0 * support["damping"] * omega * rate
                self.house_acceleration[k] = push / support["mass_kg"] - back
                self.net.rate(rate, self.house_acceleration[k])

    # Sensors and controller -------------------------------------------------------------------------------------------

    def _sensors(self) -> np.ndarray:
        hidden, n = self.hidden, self.n
        dz = self._per_bearing("sensor_position_error", "dz")
        places = [self.rig.bearings[k].sensor_position + dz[k] for k in self.of_bearing]
        y = self._along_axes(places, (self.q, self.house))
        if "sensor_misalignment" in hidden:
            angles = np.deg2rad(self._per_bearing("sensor_misalignment", "degrees"))
            turns = [np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in angles]
            y = (
                block_diag(*(t[: len(b.axes), : len(b.axes)] for t, b in zip(turns, self.rig.bearings, strict=True)))
                @ y
            )
        if "sensor_gain_error" in hidden:
            y = np.broadcast_to(hidden["sensor_gain_error"]["gain"], n)[:, None] * y
        if "sensor_runout" in hidden and self.rig.speed:
            surface = hidden["sensor_runout"]
            turning = self._oscillator(surface["harmonic"] * self.rig.speed, surface["phase"])
            angles = np.array([{"zeta": 0.0, "eta": 0.5 * np.pi}[a] for b in self.rig.bearings for a in b.axes])
            waves = np.column_stack([np.cos(angles), np.sin(angles)]) @ turning
            y = y + np.broadcast_to(surface["amplitude"], n)[:, None] * waves
        if "sensor_nonlinearity" in hidden:
            curve = hidden["sensor_nonlinearity"]
            y = y + self.net.each("polynomial", [[curve["quadratic"], curve["cubic"]]] * n, y)
        if "sensor_lag" in hidden and hidden["sensor_lag"]["tau"] > 0.0:
            y = self._lag(y, hidden["sensor_lag"]["tau"])
        y = y + self.noise
        if self.adc_step:  # what reads it does so at the start of a piece
            y = y + self.net.each("quantiser", [[self.adc_step]] * n, y, held=True)
        return y

    def _command(self, y: np.ndarray) -> np.ndarray:
        """Currents that are wanted of the amplifiers."""
        hidden, n, net = self.hidden, self.n, self.net
        controller = self.rig.controller
        held, delay = controller.is_digital, 0.0
        if held:
            i_ref = self.held
            delay = controller.delay_samples / controller.rate(self.rig.sample_rate)
        else:
            A, B, C, D = controller.state_space(n, self.rig.sample_rate)
            k = net.states(np.zeros(len(A)))
            net.rate(k, A @ k + B @ y)
            i_ref = self.i_e - C @ k - D @ y
        if "command_quantisation" in hidden:
            step = hidden["command_quantisation"]["step"]
            i_ref = i_ref + net.each("quantiser", [[step]] * n, i_ref, held=held)
        if "command_saturation" in hidden:
            level = hidden["command_saturation"]["level"]
            i_ref = i_ref + net.each("limit", [[level]] * n, i_ref, held=held)
        delay += hidden.get("loop_delay", {"seconds": 0.0})["seconds"]
        if delay > 0.0:
            i_ref = net.each("delay", [[delay]] * n, i_ref, held=held)
        if "amplifier_dead_band" in hidden:
            band = hidden["amplifier_dead_band"]["current"]
            i_ref = i_ref + net.each("dead_band", [[band]] * n, i_ref, held=held)
        if "amplifier_asymmetry" in hidden:
            fraction = hidden["amplifier_asymmetry"]["fraction"]
            i_ref = i_ref + net.each("asymmetry", [[fraction]] * n, i_ref, held=held)
        return i_ref + self._hum("current")

    # Amplifiers and magnets -------------------------------------------------------------------------------------------

    def _amplifiers(self, i_ref: np.ndarray, s: np.ndarray, s_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coil currents, and these as they are read."""
        hidden, n, net = self.hidden, self.n, self.net
        induced = hidden["back_emf"]["coefficient"] * s_rate if "back_emf" in hidden else 0.0
        drive = i_ref / (self.rig.amplifier.resistance or 1.0) - induced
        other = hidden.get("amplifier_bandwidth", {"frequency_hz": None, "time_constant": None})
        tau = self.rig.amplifier.time_constant if other["time_constant"] is None else other["time_constant"]
        if other["frequency_hz"] is None and tau == 0.0:
            assert "amplifier_voltage_limit" not in hidden, "amplifier_voltage_limit needs an amplifier with a lag"
            i_c = drive
        elif "inductance_error" in hidden:
            coil, linked = hidden["inductance_error"], net.states(np.zeros(n))  # flux linkage over the known inductance
            per_gap = np.diag([coil["gap_part"] / b.air_gap for b in self.rig.bearings for _ in b.axes])
            i_c = linked - per_gap @ net.each("product", [[]] * n, linked, s)
            net.rate(linked, (drive - i_c) / (tau * (1.0 + coil["error"])))
        else:
            i_c = net.states(np.zeros(n))
            if other["frequency_hz"] is None:
                rate = (drive - i_c) / tau
            else:
                omega = 2.0 * np.pi * other["frequency_hz"]
                rate = net.states(np.zeros(n))
                net.rate(rate, omega**2 * (drive - i_c) - 2.0 * other["damping"] * omega * rate)
            if "amplifier_voltage_limit" in hidden:
                rate = rate + net.each("limit", [[hidden["amplifier_voltage_limit"]["slew"]]] * n, rate)
            net.rate(i_c, rate)
            self.current_rate = rate
        skew = hidden.get("sampling_skew", {"seconds": 0.0})["seconds"]
        if skew == 0.0:
            return i_c, i_c
        sample = 1.0 / self.rig.sample_rate
        before = ceil(skew / sample - 1e-9) * sample - skew  # the row that is read next; whole rows are counted off
        return i_c, i_c if before < 1e-9 * sample else net.each("delay", [[before]] * n, i_c)

    def _flux(self, i_c: np.ndarray) -> np.ndarray:
        """Currents that the flux follows."""
        hidden, n, net = self.hidden, self.n, self.net
        i_f = net.states(np.zeros(n))
        rate = np.diag(1.0 / self.tau_e) @ (i_c - i_f)
        if "rate_softening" in hidden:
            rate = rate + net.each("softening", [[hidden["rate_softening"]["knee"]]] * n, rate)
        net.rate(i_f, rate)
        if "eddy_currents" in hidden and hidden["eddy_currents"]["tau"] > 0.0:
            poles, weights, constant = half_order(hidden["eddy_currents"]["tau"])
            slow = constant * i_f
            for pole, weight in zip(poles, weights, strict=True):
                slow = slow + weight * self._lag(i_f, 1.0 / pole)
            i_f = slow
        if "magnetic_hysteresis" in hidden:
            iron = hidden["magnetic_hysteresis"]
            i_f = i_f + net.each("hysteresis", [[iron["share"], iron["width"]]] * n, i_f)
        return i_f

    def _voltage(self) -> np.ndarray:
        """Faraday: R i and the rate of the flux linkage L i + K_i s of two opposed coils, u_+ - u_-."""
        coil = self.rig.amplifier
        linkage_rate = coil.coil_inductance * self.current_rate + np.diag(self.K_i) @ self.s_rate
        return coil.coil_resistance * self.i_c + linkage_rate

    def _hall(self, i: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Flux density of opposed poles, B_+ - B_-, of poles of the area A that pull with A B^2/mu_0 a side."""
        each = [(b.bias_current, b.pole_area) for b in self.rig.bearings for _ in b.axes]
        iron, i = self.hidden.get("flux_saturation", {"level": 0.0, "curve": "linear"}), self._coupled(i)
        laws = [magnet(K_i, K_s, bias, **iron) for K_i, K_s, (bias, _) in zip(self.K_i, self.K_s, each, strict=True)]
        unit = [np.sqrt(4e-7 * np.pi * law[2] / area) for law, (_, area) in zip(laws, each, strict=True)]
        if "flux_saturation" not in self.hidden and "force_nonlinearity" not in self.hidden:
            slopes = [(2.0 * u / law[0], 2.0 * u / law[1]) for u, law in zip(unit, laws, strict=True)]
            of_i, of_s = (np.diag(own) for own in zip(*slopes, strict=True))
            return of_i @ i + of_s @ s
        laws = [[*law[:2], u, 0.0, 0.0, *law[5:]] for u, law in zip(unit, laws, strict=True)]
        return self.net.each("flux", laws, i, s)

    def _coupled(self, i: np.ndarray) -> np.ndarray:
        if "axis_cross_coupling" not in self.hidden:
            return i
        pairs = [np.ones((len(b.axes),) * 2) - np.eye(len(b.axes)) for b in self.rig.bearings]
        return i + self.hidden["axis_cross_coupling"]["fraction"] * block_diag(*pairs) @ i

    def _force(self, i: np.ndarray, s: np.ndarray, s_rate: np.ndarray) -> np.ndarray:
        hidden, n, net = self.hidden, self.n, self.net
        i = self._coupled(i)
        pull = np.diag(self.K_i) @ i
        force = pull + np.diag(self.K_s) @ s + self._hum("force")
        if "force_nonlinearity" in hidden or "flux_saturation" in hidden:
            bias = [b.bias_current for b in self.rig.bearings for _ in b.axes]
            iron = hidden.get("flux_saturation", {"level": 0.0, "curve": "linear"})
            share = 1.0 if iron["level"] else hidden.get("force_nonlinearity", {"share": 0.0})["share"]
            laws = [magnet(*numbers, **iron) for numbers in zip(self.K_i, self.K_s, bias, strict=True)]
            force = force + share * net.each("magnet", laws, i, s)
        if "bias_asymmetry" in hidden:  # what is even in the square law of magnets that differ
            biases = [b.bias_current for b in self.rig.bearings for _ in b.axes]
            apart = hidden["bias_asymmetry"]["bias"]
            laws = [[*magnet(*numbers), apart] for numbers in zip(self.K_i, self.K_s, biases, strict=True)]
            force = force + 0.5 * (net.each("magnet", laws, i, s) + net.each("magnet", laws, -i, -s))
        if "cubic_bearing_force" in hidden:
            cubic = -hidden["cubic_bearing_force"]["coefficient"]
            force = force + net.each("polynomial", [[0.0, cubic]] * n, s)
        across = block_diag(*(np.eye(len(b.axes))[::-1] * (len(b.axes) - 1) for b in self.rig.bearings))
        if "rotor_contact" in hidden and hidden["rotor_contact"]["z"] is None:
            force = force + self._contact(s, s_rate, across)
        if "coulomb_friction" in hidden and hidden["coulomb_friction"]["z"] is None:
            force = force + net.each("friction", [self._friction] * n, s, across @ s)
        if "force_current_drift" in hidden:
            drift = hidden["force_current_drift"]["fraction"]
            force = force + net.each("ramp", [[drift, self.seconds]] * n, pull)
        if "parametric_stiffness" in hidden:
            spring = hidden["parametric_stiffness"]
            law = [-spring["stiffness"], 2.0 * np.pi * spring["frequency_hz"]]
            force = force + net.each("parametric", [law] * n, s)
        return force

    # Surroundings -----------------------------------------------------------------------------------------------------

    def _surroundings(self, gravity: float, load: tuple[float, float, float]) -> None:
        """Forces on the rotor that do not come from the magnets."""
        hidden, rotor = self.hidden, self.rotor
        across = np.array([[0.0, -1.0], [1.0, 0.0]]) if self.planes == 2 else np.zeros((1, 1))
        eye = np.eye(self.planes)
        for support in self.rig.rotor.support:
            self._spring(support.z, -support.stiffness * eye, -support.damping * eye)
        if "seal_forces" in hidden:
            seal = hidden["seal_forces"]
            self._spring(
                seal["z"],
                -seal["direct"] * eye + seal["cross"] * across,
                -seal["damping"] * eye + seal["cross_damping"] * across,
            )
        if "external_damping" in hidden:
            still = hidden["external_damping"]
            self.push -= still["rate"] * self.v
            self._spring(still["z"], 0.0 * eye, -still["damping"] * eye)
        if "internal_damping" in hidden:
            turning = hidden["internal_damping"]
            whirl = turning["damping"] * self.rig.speed
            self._spring(turning["z"], whirl * across, -turning["damping"] * eye)
        if "magnetic_pull" in hidden:
            pull = hidden["magnetic_pull"]
            self._spring(pull["z"], pull["stiffness"] * eye, 0.0 * eye)
        if "coupling_stiffness" in hidden:
            end = hidden["coupling_stiffness"]
            z = rotor.drive_end if end["z"] is None else end["z"]
            self._spring(z, -end["stiffness"] * eye, -end["damping"] * eye)
        if "coulomb_friction" in hidden and hidden["coulomb_friction"]["z"] is not None:
            at = rotor.at(hidden["coulomb_friction"]["z"])
            u = at @ self.q
            self.push += at.T @ self.net.each("friction", [self._friction] * self.planes, u, abs(across) @ u)
        if "rotor_contact" in hidden and hidden["rotor_contact"]["z"] is not None:
            at = rotor.at(hidden["rotor_contact"]["z"])
            self.push += at.T @ self._contact(at @ self.q, at @ self.v, abs(across))
        if "unbalance" in hidden and self.rig.speed:
            mass = hidden["unbalance"]
            turning = self._oscillator(self.rig.speed, mass["phase"])
            self.push += mass["mass_eccentricity"] * self.rig.speed**2 * rotor.at(mass["z"]).T @ turning[: self.planes]
        z, *force = load
        if gravity or any(force):
            constant = self.net.states([1.0])
            self.net.rate(constant, 0.0 * constant)
            pull = rotor.weight(gravity) + rotor.at(z).T @ np.array(force[: self.planes])
            self.push += pull[:, None] @ constant

    def _spring(self, z: float, stiffness: np.ndarray, damping: np.ndarray) -> None:
        at = self.rotor.at(z)
        self.push += at.T @ (stiffness @ at @ self.q + damping @ at @ self.v)

    def _contact(self, u: np.ndarray, rate: np.ndarray, across: np.ndarray) -> np.ndarray:
        """Force of a stop all round: stiffness times depth, and as much more as it gets deeper faster."""
        stop, n, net = self.hidden["rotor_contact"], len(u), self.net
        stiffness, clearance = stop["stiffness"], stop["clearance"]
        turns = net.each("product", [[]] * n, u, rate)  # radius times its rate, of each coordinate
        damped = net.each("contact", [[stiffness * stop["damping"], clearance, 1.0]] * n, u, across @ u)
        return net.each("contact", [[stiffness, clearance]] * n, u, across @ u) + net.each(
            "product", [[]] * n, damped, turns + across @ turns
        )

    @property
    def _friction(self) -> list[float]:
        return [float(self.hidden["coulomb_friction"][number]) for number in ("force", "stiffness", "dahl")]

    def _hum(self, port: str) -> np.ndarray:
        hum, found = self.hidden.get("periodic_disturbance"), np.zeros((self.n, CAPACITY))
        if hum and hum["port"] == port:
            axes = slice(None) if hum["axis"] is None else [hum["axis"]]
            found[axes] = hum["amplitude"] * self._oscillator(2.0 * np.pi * hum["frequency_hz"], hum["phase"])[1]
        return found

    def _oscillator(self, omega: float, phase: float) -> np.ndarray:
        """Cosine and sine of ``omega t + phase``."""
        angle = phase - omega * self.before
        both = self.net.states([np.cos(angle), np.sin(angle)])
        self.net.rate(both, omega * np.array([[0.0, -1.0], [1.0, 0.0]]) @ both)
        return both

    def _lag(self, signal: np.ndarray, tau: float) -> np.ndarray:
        lagged = self.net.states(np.zeros(len(signal)))
        self.net.rate(lagged, (signal - lagged) / tau)
        return lagged

    def _per_bearing(self, effect: str, name: str) -> np.ndarray:
        return np.broadcast_to(self.hidden.get(effect, {name: 0.0})[name], len(self.rig.bearings))
