"""The plant: rotor, amplifiers, actuators and magnets, from the commands i_ref to the outputs y and i_c."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambid.arrays import FloatArray
from ambid.errors import ModelError
from ambid.loop.assembly import ZERO, Assembly, GainError, LateOutput, Lft, Signal, combine
from ambid.loop.geometry import axes_in_planes, sensors_in_planes
from ambid.rig import Rig, Sensor
from ambid.rotor import ReducedRotor

EXCITATION = "excitation"
"""What a `GainError` of i_e is of."""
READING = ("at_sensor", "turned", "scaled", "y")
"""What becomes of a displacement until it is read, in this order whatever the order of the effects."""
RECORDING = ("exchanged", "reversed", "recorded")
"""What becomes of y and i_c on the way into the record, likewise: cables, polarity, scale."""
HEARD = "heard."
"""Before the name of a channel: as the controller reads it, where the record holds something else."""


SENSED, READ = "sensed.", "read."
"""What the names of signals begin with that an instrument beside those of y and i_c is exposed to, and that it reads:
the same but for its gain."""
MOTION = {"y": "eta", "a": "eta_bend"}
"""What the signals of sensors read, as `Plant.at` takes it."""


class Plant(Assembly):
    """The base plant as named signals, ready for effects to be attached.

    ``tau_a i_a' = i_set - i_a``, ``tau_e i_f' = i_a - i_f``, ``f = K_i i_f + K_s s``. K_i, K_s and 1/tau_e are entries
    of Delta (B_Delta, C_Delta of eqs. 4-7). ``i_set`` is the command i_ref; of a voltage-driven coil it is i_ref / R,
    where i_ref is in V and 1/R is an entry of Delta. An ideal amplifier, or an actuator without lag, has no state.
    Supports of the rig push at their places.

    Signals of each axis: ``i_ref`` [A or V] that leaves the controller, ``i_set`` [A] that it asks for, ``i_a`` [A]
    behind the amplifier, its rate ``i_a_free`` [A/s] before and ``i_a_rate`` behind what limits it, ``i_c`` [A] as
    recorded, ``i_f`` [A] that makes force and its rate
    ``i_f_rate`` [A/s], ``s`` [m] and ``v`` [m/s] at the magnet, ``f`` [N]; ``at_sensor`` [m] at the sensor, ``turned``
    along its axis, ``scaled`` by its gain, and ``y`` as read, each made of the one before. y and i_c go on into the
    record as ``exchanged.y``, ``reversed.y`` and ``recorded.y``, which no controller reads; further channels
    are ``sensed.<channel>`` before the gain of their instrument, and ``read.<channel>``. Of each modal coordinate k:
    ``eta.k``, ``eta_rate.k``, ``eta_bend.k``, ``modal_force.k``. The parameters of effects are stated for the rig
    `reference`, which is another operating point of this machine where records of several are fitted together; further
    channels are read where they are among those `measured`.

    Parameters
    ----------
    rig : Rig
    rotor : ReducedRotor
        Of the same rig, known at its bearings and sensors, and wherever effects act.
    free_modes : int
        Last modes of each plane that get no stiffness and damping here: an effect gives them.
    """

    def __init__(self, rig: Rig, rotor: ReducedRotor, *, free_modes: int = 0) -> None:
        super().__init__()
        self.rig, self.rotor = rig, rotor
        self.reference = rig
        self.late: str | None = None
        self.late_outputs: list[LateOutput] = []
        self.gain_errors: list[GainError] = []
        self.excitation = {stage: np.eye(len(rig.axes)) for stage in RECORDING[:2]}
        self.amplifier_rates: dict[str, tuple[str, ...]] = {}
        self.axes = rig.axes
        self.measured: tuple[str, ...] = ()
        self.directions = axes_in_planes(rig, rotor.planes)
        self.coordinates = len(rotor.frequencies_rad_s) * rotor.planes
        self.magnets = [b.position for b in rig.bearings for _ in b.axes]
        self.sensors = [b.sensor_position for b in rig.bearings for _ in b.axes]
        held = np.ones(len(rotor.frequencies_rad_s))
        held[len(held) - free_modes :] = 0.0
        omega = np.tile(held * rotor.frequencies_rad_s, rotor.planes)
        zeta = np.tile(rotor.damping, rotor.planes)

        eta = [self.state(f"eta.{k}") for k in range(self.coordinates)]
        rates = [self.state(f"eta_rate.{k}") for k in range(self.coordinates)]
        for k in range(self.coordinates):
            self.signal(f"eta.{k}", eta[k])
            self.signal(f"eta_rate.{k}", rates[k])
        commands = [self.input(f"i_ref.{axis}") for axis in self.axes]
        for axis in self.axes if rig.controller.follows_reference else ():
            self.input(f"r.{axis}")  # which the controller alone takes
        i_a = [self._amplifier(axis, command) for axis, command in zip(self.axes, commands, strict=True)]
        i_f = [self._actuator(axis, current) for axis, current in zip(self.axes, i_a, strict=True)]
        s = [
            self.signal(f"s.{axis}", self.at(z, direction))
            for axis, z, direction in zip(self.axes, self.magnets, self.directions, strict=True)
        ]
        for axis, z, direction in zip(self.axes, self.magnets, self.directions, strict=True):
            self.signal(f"v.{axis}", self.at(z, direction, "eta_rate"))
        from_current = [self.port(f"K_i.{axis}", i) for axis, i in zip(self.axes, i_f, strict=True)]
        from_motion = [self.port(f"K_s.{axis}", x) for axis, x in zip(self.axes, s, strict=True)]
        for axis, a, b in zip(self.axes, from_current, from_motion, strict=True):
            self.signal(f"f.{axis}", a + b)
        for axis, z, direction in zip(self.axes, self.sensors, self.directions, strict=True):
            read = self.at(z, direction)
            for signal in READING:
                read = self.signal(f"{signal}.{axis}", read)
        for name in self.channels:
            read = self[name]
            for stage in RECORDING:
                read = self.signal(f"{stage}.{name}", read)

        onto = np.array([self.shape(z, d) for z, d in zip(self.magnets, self.directions, strict=True)])
        forces = [self[f"f.{axis}"] for axis in self.axes]
        coupling = rotor.coupling(rig.speed)
        for k in range(self.coordinates):
            force = self.signal(f"modal_force.{k}", combine(onto[:, k], forces))
            turning = combine(-coupling[k], rates)
            self.set_rate(f"eta.{k}", rates[k])
            damping = rotor.mass_damping + 2.0 * zeta[k] * omega[k]
            held_back = -(omega[k] ** 2) * eta[k] - damping * rates[k]
            self.set_rate(f"eta_rate.{k}", self.signal(f"eta_bend.{k}", force + turning + held_back))
        for support in rig.rotor.support:
            for plane in np.eye(rotor.planes):
                u, rate = (self.at(support.z, plane, of) for of in ("eta", "eta_rate"))
                self.push(support.z, plane, -support.stiffness * u - support.damping * rate)
        self._further_outputs()

    def _further_outputs(self) -> None:
        """What further instruments read, by the names of their channels.

        The flux density b = f/(2 A B_0/mu_0) is that of the force which is linear in current and displacement, behind
        eddy currents and hysteresis. The voltage u = R i_a + L i_a' + e of a coil whose voltage is commanded is the
        command; back-EMF e and limits add to both sides. Where current is commanded, e = K_i v: a magnet without losses
        makes as much electric power of motion as mechanical power of current. Acceleration at a sensor is that by all
        forces on the rotor. A housing is at rest until an effect moves it.
        """
        for axis, gain in self.rig.force_per_flux.items():
            self._instrument(f"b.{axis}", self.raw(f"f.{axis}") / gain)
        for axis in self.axes:
            self._instrument(f"f.{axis}", self[f"f.{axis}"])
            self._instrument(f"u.{axis}", self._voltage(axis))
        for own, direction in zip(self.rig.sensors, sensors_in_planes(self.rig, self.rotor.planes), strict=True):
            motion = ZERO if own.housing else self.at(own.z, direction, MOTION[own.signal])
            self._instrument(own.channel, motion)

    def _instrument(self, channel: str, sensed: Signal) -> None:
        self.signal(f"{READ}{channel}", self.signal(f"{SENSED}{channel}", sensed))

    def on_housing(self, axis: str) -> dict[Sensor, float]:
        """Sensors on the housing of an axis, each with what it reads of a motion along that axis."""
        bearing = next(own for own in self.rig.bearings if axis in own.axis_names)
        along = sensors_in_planes(self.rig, self.rotor.planes) @ self.directions[self.axes.index(axis)]
        sensors = zip(self.rig.sensors, along, strict=True)
        return {own: float(part) for own, part in sensors if own.housing == bearing.name}

    def _voltage(self, axis: str) -> Signal:
        """Of the coils of an axis [V]; the command where the rig file does not say what they are."""
        amplifier = self.rig.amplifier
        if amplifier.coil_resistance is None or amplifier.coil_inductance is None:
            return self[f"i_ref.{axis}"]
        of_current = (
            amplifier.coil_resistance * self[f"i_a.{axis}"] + amplifier.coil_inductance * self[f"i_a_rate.{axis}"]
        )
        return of_current + self.port(f"K_i.{axis}", self[f"v.{axis}"])

    def shape(self, z: float, direction: np.ndarray) -> np.ndarray:
        """Displacement of every modal coordinate at `z` in a direction of the planes, shape (coordinates,)."""
        return np.outer(direction, self.rotor.shape(z)).ravel()

    def at(self, z: float, direction: np.ndarray, of: str = "eta") -> Signal:
        """Displacement of the rotor at `z`, its velocity (``eta_rate``) or acceleration (``eta_bend``)."""
        return combine(self.shape(z, direction), [self[f"{of}.{k}"] for k in range(self.coordinates)])

    def push(self, z: float, direction: np.ndarray, force: Signal) -> None:
        """Let a force act on the rotor at `z`."""
        for k, onto in enumerate(self.shape(z, direction)):
            if onto:
                self.inject(f"modal_force.{k}", onto * force)

    def of_amplifier(self, axis: str, name: str, rates: Sequence[Signal]) -> list[Signal]:
        """Rates of the states of the amplifier of an axis, in place of any before; an error of its lag slows them."""
        names = tuple(f"{name}_{k}.{axis}" for k in range(len(rates)))
        self.amplifier_rates[axis] = names
        return [self.signal(own, rate) for own, rate in zip(names, rates, strict=True)]

    def cut(self, axis: str) -> Signal:
        """What limits take off the rate of a current [A/s]."""
        return self[f"i_a_rate.{axis}"] - self.raw(f"i_a_rate.{axis}")

    @property
    def channels(self) -> list[str]:
        """Names of y, then i_c of every axis."""
        return [f"{signal}.{axis}" for signal in ("y", "i_c") for axis in self.axes]

    def scale(self, signal: str, slot: str) -> None:
        """Let a named signal differ by the relative error that fills a slot."""
        self.inject(signal, self.port(slot, self.raw(signal)))

    def mix(self, stage: str, signal: str, matrix: FloatArray) -> None:
        """Let a signal of all axes be recorded as a matrix times itself, at a stage of `RECORDING`; of i_e its inverse.

        Parameters
        ----------
        stage : str
        signal : {"y", "i_c", "i_e"}
        matrix : ndarray, shape (axes, axes)
            Its own inverse: of signs, or one that exchanges axes.
        """
        if signal == "i_e":
            self.excitation[stage] = matrix @ self.excitation[stage]
            return
        true = [self.raw(f"{stage}.{signal}.{axis}") for axis in self.axes]
        for axis, change in zip(self.axes, matrix - np.eye(len(true)), strict=True):
            if change.any():
                self.inject(f"{stage}.{signal}.{axis}", combine(change, true))

    def delay_commands(self, slot: str) -> None:
        """Let everything that leaves the controller arrive late, by what fills a slot [s].

        Raises
        ------
        ModelError
            If something else delays it already.
        """
        if self.late is not None:
            raise ModelError(f"{slot} and {self.late} both delay the commands; keep one of the two")
        self.late = slot

    def record_late(self, output: str, slot: str, scale: float = 1.0) -> None:
        """Let an output, such as ``i_c.A_zeta``, be recorded late by `scale` times what fills a slot [s]."""
        self.late_outputs.append(LateOutput(output, slot, scale))

    def scale_controller(self, slot: str, gain: str) -> None:
        """Let a gain of the controller, or all of it (``gain``), differ by the relative error that fills a slot."""
        self.gain_errors.append(GainError(slot, gain))

    def scale_excitation(self, slot: str, axes: Sequence[str] = ()) -> None:
        """Let i_e of some axes, or all, differ from the record by the relative error that fills a slot."""
        self.gain_errors.append(GainError(slot, EXCITATION, tuple(axes or self.axes)))

    def _amplifier(self, axis: str, command: Signal) -> Signal:
        i_ref = self.signal(f"i_ref.{axis}", command)
        amplifier = self.rig.amplifier
        is_voltage = amplifier.resistance is not None
        i_set = self.signal(f"i_set.{axis}", self.port(f"R.{axis}", i_ref, power=-1) if is_voltage else i_ref)
        if amplifier.time_constant == 0.0:
            i_a = self.signal(f"i_a.{axis}", i_set)
            for signal in ("i_a_free", "i_a_rate"):
                self.signal(f"{signal}.{axis}", ZERO)
        else:
            state = self.state(f"i_a.{axis}")
            i_a = self.signal(f"i_a.{axis}", state)
            rate = self.of_amplifier(axis, "i_a_own", [(i_set - state) / amplifier.time_constant])[0]
            self.signal(f"i_a_rate.{axis}", self.signal(f"i_a_free.{axis}", rate))
            self.set_rate(f"i_a.{axis}", rate + self.cut(axis))
        self.signal(f"i_c.{axis}", i_a)
        return i_a

    def _actuator(self, axis: str, i_a: Signal) -> Signal:
        if not self.rig.actuator.has_lag:
            self.signal(f"i_f_rate.{axis}", self[f"i_a_rate.{axis}"])
            return self.signal(f"i_f.{axis}", i_a)
        state = self.state(f"i_f.{axis}")
        rate = self.signal(f"i_f_rate.{axis}", self.port(f"tau_e.{axis}", i_a - state, power=-1))
        self.set_rate(f"i_f.{axis}", rate)
        return self.signal(f"i_f.{axis}", state)

    def between_commands_and_outputs(self, more: Sequence[str] = ()) -> Lft:
        """Inputs ``i_ref.<axis>``, ``r.<axis>`` where the controller has a reference, and those of effects.

        Outputs are channels that are `measured`, those of y and i_c that are not among them, both as recorded, then
        `more` of every axis, then what the controller reads and the record does not hold.
        """
        first = [*self.measured, *(name for name in self.channels if name not in self.measured)]
        watched = [f"{signal}.{axis}" for signal in more for axis in self.axes]
        read = [name for name in self.channels if name.split(".")[0] in self.rig.controller.signals]
        heard = [name for name in read if self.is_changed(*(f"{stage}.{name}" for stage in RECORDING))]
        recorded = [f"{RECORDING[-1]}.{name}" if name in self.channels else READ + name for name in first]
        own = self.lft([*recorded, *watched, *heard])
        outputs = (*first, *watched, *(f"{HEARD}{name}" for name in heard))
        late, errors = tuple(self.late_outputs), tuple(self.gain_errors)
        acts = self.excitation["exchanged"] @ self.excitation["reversed"]
        return replace(own, outputs=outputs, late=self.late, late_outputs=late, gain_errors=errors, excitation=acts)
