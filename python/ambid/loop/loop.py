"""The closed loop, compiled for the Rust core: simulation, sensitivities, poles, one sample at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray, StateSpace
from ambid.errors import ModelError, RigError, UnstableLoopError
from ambid.loop.assembly import Block, Lft
from ambid.loop.controller import Reading, close_analog, law_errors
from ambid.loop.delay import with_late_rows
from ambid.loop.effect import Effect
from ambid.loop.geometry import rotor_of
from ambid.loop.mode import Modes, eigenmodes, moved_by_worst
from ambid.loop.plant import HEARD, Plant
from ambid.loop.response import frequency_response
from ambid.rig import Rig
from ambid.rotor import ReducedRotor

MOST_STATES = 800
"""States of a loop: its poles then take some seconds, which grow by the cube of the number, and cannot be stopped."""


class Loop:
    """A rig's closed loop with named inputs, outputs and parameters.

    Parameters
    ----------
    rig : Rig
    filled_by : dict of str to int
        Index in the parameter vector for each slot of Delta, such as ``{"K_i.A_zeta": 0, ...}``.
    effects : sequence of Effect
        Physics that is attached to the plant.
    noise : bool
        Whether sensor noise is a further input of each axis, and that of i_c where the controller reads it.
    watch : sequence of str
        Signals of the plant that become further outputs of each axis, such as ``s`` and ``i_f``.
    substeps : int, optional
        Steps per sample of nonlinear effects; default: as many as the response needs to be exact to 1e-6.
    reference : Rig, optional
        The same machine at the operating point that the parameters of effects are stated for; default: `rig`.
    parameters : int, optional
        Length of the parameter vector; default: up to the last index in `filled_by`.
    measured : sequence of str
        Channels that are the first outputs, y among them, where a record holds more than y and i_c.

    Attributes
    ----------
    lft : Lft
        G with its ports; for a digital controller without it, commands to outputs, else the closed loop. Where an
        effect delays the commands, its inputs are what has arrived.
    inputs, outputs : tuple of str
        Names, such as ``i_e.A_zeta``, ``r.A_zeta``; ``y.A_zeta``, ..., ``i_c.A_zeta``.
    driven : int
        How many of the inputs, the first, a record holds: i_e, and r where the controller has a reference.
    core : _core.ClosedLoop
    """

    def __init__(
        self,
        rig: Rig,
        filled_by: dict[str, int],
        effects: Sequence[Effect] = (),
        *,
        noise: bool = False,
        watch: Sequence[str] = (),
        substeps: int | None = None,
        reference: Rig | None = None,
        parameters: int | None = None,
        measured: Sequence[str] = (),
    ) -> None:
        between = open_plant(rig, effects, watch, reference, noise=noise, measured=measured)
        matrices, errors = _controller(rig), law_errors(between, rig)
        self._is_analog = not rig.controller.is_digital
        late = None if between.late is None else filled_by[between.late]
        controller: _core._DigitalController | None = None
        if rig.controller.is_digital:
            reading = Reading.of(rig, between.outputs, between.inputs)
            controller = {
                "matrices": matrices,
                "reads": reading.outputs,
                "takes": reading.inputs,
                "hidden": sum(name.startswith(HEARD) for name in between.outputs),
                "delay": rig.controller.delay_samples,
                "late": late,
                "steps": round(rig.controller.rate(rig.sample_rate) / rig.sample_rate),
                "excitation": between.excitation,
                "errors": [(filled_by[error.slot], error.C, error.D, error.excitation) for error in errors],
            }
            self.lft = between
            self.inputs = tuple(name.replace("i_ref.", "i_e.") for name in between.inputs)
        else:
            self.lft = close_analog(between, rig, matrices, errors)
            self.inputs = self.lft.inputs
            if late is not None:
                controller = {"matrices": _idle(rig), "delay": 0.0, "late": late, "steps": 1}
        self.outputs = tuple(name for name in self.lft.outputs if not name.startswith(HEARD))
        self.driven = sum(name.startswith(("i_e.", "r.")) for name in self.inputs)
        self._rotor = rotor_of(rig, _further_modes(rig, effects))
        self.sample_time = 1.0 / rig.sample_rate
        _require_few_states(rig, len(self.lft.A), len(matrices[0]) if rig.controller.is_digital else 0)
        gains = [(filled_by[port.slot], port.scale, port.power) for port in self.lft.ports]
        self._filled_by = filled_by
        self.parameters = 1 + max(filled_by.values(), default=-1) if parameters is None else parameters
        self.core = _core.ClosedLoop(
            _matrices(self.lft.A, self.lft.B, self.lft.C, self.lft.D),
            gains,
            self.parameters,
            self.sample_time,
            controller,
            [_block(block, filled_by) for block in self.lft.blocks],
            substeps,
            [(self.outputs.index(o.output), filled_by[o.slot], o.scale) for o in self.lft.late_outputs],
        )

    def simulate(self, theta: ArrayLike, u: ArrayLike) -> FloatArray:
        """Exact zero-order-hold response from rest.

        Parameters
        ----------
        theta : array_like, shape (parameters,)
        u : array_like, shape (N, inputs)
            Each row is held from its sample to the next.

        Returns
        -------
        ndarray, shape (N, outputs)

        Raises
        ------
        UnstableLoopError
            If the loop is unstable at `theta`.
        """
        values, inputs = _vector(theta), _signal(u)
        with self.naming_the_mode(values):
            return self.core.simulate(values, inputs)

    def sensitivity(self, theta: ArrayLike, u: ArrayLike, free: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Response and its exact derivative by the parameters in `free`.

        Returns
        -------
        y : ndarray, shape (N, outputs)
        jacobian : ndarray, shape (N, outputs, len(free))

        Raises
        ------
        ModelError
            If there is no such parameter.
        UnstableLoopError
            If the loop is unstable at `theta`.
        """
        for index in free:
            if not 0 <= index < self.parameters:
                raise ModelError(f"free parameter {index} is not one of the {self.parameters}, which count from 0")
        values, inputs = _vector(theta), _signal(u)
        with self.naming_the_mode(values):
            return self.core.sensitivity(values, list(free), inputs)

    @contextmanager
    def naming_the_mode(self, theta: FloatArray) -> Iterator[None]:
        """Let the error of an unstable loop say what the growing pole moves."""
        try:
            yield
        except UnstableLoopError as error:
            sampled = self.core.discrete(theta)[0]
            if np.abs(np.linalg.eigvals(sampled)).max() <= 1.0:  # a nonlinear response that leaves all bounds
                raise
            raise UnstableLoopError(f"{error}; {moved_by_worst(sampled, self._rotor)}") from None

    def poles(self, theta: ArrayLike) -> np.ndarray:
        """Poles of the closed loop [1/s], shape (states,), slowest first; -inf of what is gone within a sample."""
        poles = self.core.poles(_vector(theta))
        return poles[np.lexsort((poles.imag, -poles.real))]

    def modes(self, theta: ArrayLike, free: Sequence[int] = ()) -> Modes:
        """Poles of the closed loop, the outputs that they move, and their derivatives by the parameters in `free`.

        Nonlinear effects are linearised at rest; then `free` must be empty.
        """
        values = _vector(theta)
        if not self._is_analog:
            A, _, C, _ = self.core.discrete(values)
            slopes = self.core.discrete_slopes(values, list(free)).reshape(len(free), *A.shape)
            return eigenmodes(A, C, slopes, self.sample_time)
        at = {slot: values[index] for slot, index in self._filled_by.items()}
        A, B, C, _ = self.lft.closed_with_ports(at)
        slopes = np.zeros((self.parameters, len(A), len(A)))
        for k, port in enumerate(self.lft.ports):
            left, right = B[:, len(self.inputs) + k], C[len(self.outputs) + k]
            slopes[self._filled_by[port.slot]] += port.slope(at[port.slot]) * np.outer(left, right)
        return eigenmodes(A, C[: len(self.outputs)], slopes[list(free)])

    def state_space(self, theta: ArrayLike) -> StateSpace:
        """A, B, C, D of the loop sampled with zero-order hold, inputs to outputs.

        Raises
        ------
        ModelError
            If an output is recorded early by a sample and more.
        """
        return with_late_rows(self.core.discrete(_vector(theta)), self.core.shifts(_vector(theta)))

    def transfer(self, theta: ArrayLike, points: ComplexArray) -> ComplexArray:
        """Held inputs to sampled outputs at points of the unit circle, shape (points, outputs, inputs).

        Nonlinear effects are linearised at rest.

        Raises
        ------
        UnstableLoopError
            If the loop is unstable at `theta`.
        """
        return self.core.transfer(_vector(theta), np.ascontiguousarray(points, dtype=np.complex128))

    def frequency_response(self, theta: ArrayLike, frequency_hz: FloatArray) -> ComplexArray:
        """Inputs to outputs, shape (frequencies, outputs, inputs), nonlinear effects linearised at rest.

        Of an analog loop in continuous time, of a digital one from held inputs to samples.
        """
        if self._is_analog:
            values = _vector(theta)
            at = {slot: values[index] for slot, index in self._filled_by.items()}
            response = frequency_response(self.lft.closed(at), 2j * np.pi * frequency_hz)
            if self.lft.late is not None:
                excited = [k for k, name in enumerate(self.inputs) if name.startswith("i_e.")]
                response[:, :, excited] *= np.exp(-2j * np.pi * frequency_hz * at[self.lft.late])[:, None, None]
            response *= self._recorded(at, frequency_hz)[:, :, None]
            return response
        points = np.exp(2j * np.pi * frequency_hz * self.sample_time)
        response = frequency_response(self.core.discrete(_vector(theta)), points)
        response *= np.power(points[:, None], -np.array(self.core.shifts(_vector(theta))))[:, :, None]
        return response

    def _recorded(self, at: dict[str, float], frequency_hz: FloatArray) -> ComplexArray:
        """By what outputs that are recorded late are multiplied in continuous time, shape (frequencies, outputs)."""
        late = np.zeros(len(self.outputs))
        for own in self.lft.late_outputs:
            late[self.outputs.index(own.output)] += own.scale * at[own.slot]
        return np.exp(-2j * np.pi * np.outer(frequency_hz, late))

    def frequency_slopes(
        self, theta: ArrayLike, frequency_hz: FloatArray, u: ComplexArray, free: Sequence[int]
    ) -> ComplexArray:
        """Exact derivative of `frequency_response`, times inputs `u`, by the parameters in `free`.

        Parameters
        ----------
        theta : array_like, shape (parameters,)
        frequency_hz : ndarray, shape (F,)
        u : ndarray, shape (F, inputs)
        free : sequence of int

        Returns
        -------
        ndarray, shape (F, outputs, len(free))

        Raises
        ------
        UnstableLoopError
            If a digital loop is unstable at `theta`.
        """
        values, inputs = _vector(theta), np.array(u, dtype=np.complex128)
        if not self._is_analog:
            points = np.exp(2j * np.pi * frequency_hz * self.sample_time)
            return self.core.lines(values, list(free), points, inputs, None, False)[1]
        at = {slot: values[index] for slot, index in self._filled_by.items()}
        s, outputs = 2j * np.pi * frequency_hz, len(self.outputs)
        if self.lft.late is not None:
            excited = [k for k, name in enumerate(self.inputs) if name.startswith("i_e.")]
            inputs[:, excited] *= np.exp(-s * at[self.lft.late])[:, None]
        response = frequency_response(self.lft.closed_with_ports(at), s)
        seen = np.einsum("lzu,lu->lz", response[:, outputs:, : len(self.inputs)], inputs)
        slopes = np.zeros((len(s), outputs, self.parameters), dtype=np.complex128)
        for k, port in enumerate(self.lft.ports):
            slope = port.slope(at[port.slot])
            of_w = response[:, :outputs, len(self.inputs) + k]
            slopes[:, :, self._filled_by[port.slot]] += of_w * (slope * seen[:, k])[:, None]
        if self.lft.late is not None:
            late = np.einsum("lyu,lu->ly", response[:, :outputs][:, :, excited], inputs[:, excited])
            slopes[:, :, self._filled_by[self.lft.late]] -= s[:, None] * late
        whole = np.einsum("lyu,lu->ly", response[:, :outputs, : len(self.inputs)], inputs)
        for own in self.lft.late_outputs:
            output = self.outputs.index(own.output)
            slopes[:, output, self._filled_by[own.slot]] -= own.scale * s * whole[:, output]
        slopes *= self._recorded(at, frequency_hz)[:, :, None]
        return slopes[:, :, list(free)]

    def packed(self, theta: ArrayLike, parameters: Sequence[str]) -> bytes:
        """The loop at `theta` as a file for the stepper without Python, with names for the parameters.

        Raises
        ------
        ModelError
            If the loop is too large to be stepped.
        """
        return self.core.packed(_vector(theta), self.inputs, self.outputs, parameters)

    def simulator(self, theta: ArrayLike) -> Simulator:
        """Return the loop at `theta`, at rest, to be stepped sample by sample."""
        return Simulator(self, theta)


class Simulator:
    """Embedded simulator: takes one sample of the excitation, returns the outputs of that instant.

    Unlike `Loop.simulate` it also runs an unstable loop, since the real one would do so too.

    Parameters
    ----------
    loop : Loop
    theta : array_like, shape (parameters,)
    """

    def __init__(self, loop: Loop, theta: ArrayLike) -> None:
        self.inputs, self.outputs = loop.inputs, loop.outputs
        self._stepper = _core.Stepper(loop.core, _vector(theta))

    def step(self, u: ArrayLike) -> FloatArray:
        """Outputs now, shape (outputs,); `u`, shape (inputs,), is held until the next call."""
        return self._stepper.step(_vector(u))

    def run(self, u: ArrayLike) -> FloatArray:
        """Outputs, shape (N, outputs), while stepping through `u`, shape (N, inputs), from the present state."""
        return self._stepper.run(_signal(u))

    def reset(self) -> None:
        """Back to rest."""
        self._stepper.reset()


def _block(block: Block, filled_by: dict[str, int]) -> _core._Block:
    """A nonlinear block as the core wants it."""
    chosen: _core._Block = {
        "law": block.law,  # type: ignore[typeddict-item]
        "parameters": {name: filled_by[slot] for name, slot in block.slots.items()},
        "constants": block.constants,
    }
    chosen.update(block.shape)  # type: ignore[typeddict-item]
    return chosen


def open_plant(
    rig: Rig,
    effects: Sequence[Effect],
    watch: Sequence[str] = (),
    reference: Rig | None = None,
    *,
    noise: bool = False,
    measured: Sequence[str] = (),
) -> Lft:
    """The plant with all effects attached; bending modes that effects bring are the last of the rotor.

    With `noise`, that of i_c is a further input ``n_i.<axis>`` where the controller reads it, and that of y
    ``n.<axis>``, the last.
    """
    more = _further_modes(rig, effects)
    rotor = rotor_of(rig, more)
    for effect in effects:
        try:
            for z in effect.positions(rig):
                rotor.shape(z)
        except RigError as error:  # a place that is known without the bending modes that other effects bring
            raise ModelError(f"{effect.name}: {error}") from None
    built = _base_plant(rig, rotor, more).copy()
    built.reference, built.measured = rig if reference is None else reference, tuple(measured)
    for effect in effects:
        effect.attach(built)
    noisy = {"i_c": "n_i"} if "i_c" in rig.controller.signals else {}
    for signal, of_signal in (noisy | {"y": "n"}).items() if noise else ():
        for axis in rig.axes:
            built.inject(f"{signal}.{axis}", built.input(f"{of_signal}.{axis}"))
    return built.between_commands_and_outputs(watch)


def _further_modes(rig: Rig, effects: Sequence[Effect]) -> int:
    """Bending modes that effects bring."""
    return sum(effect.flexible_modes(rig) for effect in effects)


@lru_cache(maxsize=32)
def _base_plant(rig: Rig, rotor: ReducedRotor, free_modes: int) -> Plant:
    """The plant before effects; many loops start from the same."""
    return Plant(rig, rotor, free_modes=free_modes)


@lru_cache(maxsize=32)
def _controller(rig: Rig) -> StateSpace:
    """A, B, C, D of the rig's controller."""
    return _matrices(*rig.controller.state_space(len(rig.axes), rig.sample_rate))


def _require_few_states(rig: Rig, plant: int, controller: int) -> None:
    """Refuse a loop of more than `MOST_STATES`: of the plant, of a digital controller, and commands under way."""
    under_way = len(rig.axes) * ceil(rig.controller.delay_samples) if rig.controller.is_digital else 0
    if plant + controller + under_way > MOST_STATES:
        raise ModelError(
            f"the loop has {plant + controller + under_way} states ({plant} of rotor, actuators and effects, "
            f"{controller} of a digital controller, {under_way} commands under way); allowed are {MOST_STATES}. Keep "
            "fewer bending modes, give the controller a lower order, or check controller.delay_samples."
        )


def _idle(rig: Rig) -> StateSpace:
    """A controller that does nothing, so that it only delays the excitation."""
    m = len(rig.axes)
    return np.zeros((0, 0)), np.zeros((0, m)), np.zeros((m, 0)), np.zeros((m, m))


def _matrices(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> StateSpace:
    """The same matrices as the core wants them."""
    return (
        np.ascontiguousarray(a, dtype=np.float64),
        np.ascontiguousarray(b, dtype=np.float64),
        np.ascontiguousarray(c, dtype=np.float64),
        np.ascontiguousarray(d, dtype=np.float64),
    )


def _vector(values: ArrayLike) -> FloatArray:
    vector = np.ascontiguousarray(values, dtype=np.float64)
    if vector.ndim != 1:
        raise ModelError(f"a vector is needed, found an array of shape {vector.shape}")
    if not np.isfinite(vector).all():
        index = int(np.argmin(np.isfinite(vector)))
        raise ModelError(f"finite numbers are needed, found {vector[index]} at index {index} of a vector")
    return vector


def _signal(values: ArrayLike) -> FloatArray:
    signal = np.ascontiguousarray(values, dtype=np.float64)
    if signal.ndim != 2:
        raise ModelError(f"a signal of shape (samples, channels) is needed, found shape {signal.shape}")
    if not np.isfinite(signal).all():
        sample, channel = np.argwhere(~np.isfinite(signal))[0]
        found = f"{signal[sample, channel]} at sample {sample} of channel {channel}"
        raise ModelError(f"finite numbers are needed, found {found} of a signal; repair or cut the record")
    return signal
