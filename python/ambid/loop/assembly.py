"""A linear fractional transformation put together from named signals, so that physics can be added at any of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ambid.arrays import FloatArray, StateSpace


@dataclass(frozen=True)
class Port:
    """One diagonal entry of Delta: ``w = scale * value**power * z``.

    Attributes
    ----------
    slot : str
        What the entry stands for, such as ``K_i.A_zeta``; a parameter fills one slot or several.
    power : int
        1 for K_i and K_s, -1 for a time constant.
    scale : float
        Constant factor.
    """

    slot: str
    power: int = 1
    scale: float = 1.0

    def slope(self, value: float) -> float:
        """Derivative of the entry by the value."""
        return self.scale * self.power * value ** (self.power - 1)


@dataclass(frozen=True)
class Block:
    """One nonlinear entry of Delta: a number w from one or two signals z by a law of the core.

    Attributes
    ----------
    law : str
        ``force_law``, ``limit``, ``bouc_wen``, ``stop``, ``table`` or ``polynomial``; see `_core.ClosedLoop`.
    signals : int
        Number of signals z, 1 or 2.
    slots : mapping of str to str
        What each uncertain coefficient of the law stands for, such as ``{"K_i": "K_i.A_zeta"}``.
    constants : mapping of str to float
        All other coefficients.
    shape : mapping
        What else the law takes: ``curve``, ``exponents``, or ``values`` with ``first`` and ``spacing``.
    """

    law: str
    signals: int
    slots: Mapping[str, str]
    constants: Mapping[str, float] = field(default_factory=dict)
    shape: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class GainError:
    """Relative error of a gain of the controller, or of the excitation that is added to its output.

    Attributes
    ----------
    slot : str
        What the error stands for, such as ``controller_gain_error.proportional``.
    gain : str
        One of `Controller.gains`, ``gain`` for all of the controller, or ``excitation``.
    axes : tuple of str
        Whose excitation it is of.
    """

    slot: str
    gain: str
    axes: tuple[str, ...] = ()


@dataclass(frozen=True)
class LateOutput:
    """An output that is recorded late by ``scale`` times what fills a slot [s]; early where that is negative.

    Several delays of one output add up. What a controller reads is not late.

    Attributes
    ----------
    output : str
        Such as ``i_c.A_zeta``.
    slot : str
    scale : float
    """

    output: str
    slot: str
    scale: float = 1.0


@dataclass(frozen=True)
class Lft:
    """G with its Delta: ``x' = A x + B [u; w]``, ``[y; z] = C x + D [u; w]``, ``w = Delta z`` (eq. 8, Fig. 3).

    Attributes
    ----------
    A : ndarray, shape (n, n)
    B : ndarray, shape (n, inputs + ports + blocks)
    C : ndarray, shape (outputs + ports + signals of all blocks, n)
    D : ndarray, shape (outputs + ports + signals of all blocks, inputs + ports + blocks)
    inputs, outputs : tuple of str
        Names of the signals u and y, such as ``i_ref.A_zeta`` and ``y.A_zeta``.
    ports : tuple of Port
        Linear entries of Delta, in the order of w and z.
    blocks : tuple of Block
        Nonlinear entries, after the linear ones.
    late : str or None
        Slot of a delay [s] after which what enters as a command acts; its inputs are what has arrived.
    late_outputs : tuple of LateOutput
        Outputs that are recorded late or early.
    gain_errors : tuple of GainError
        Of the controller that is to be closed around it.
    excitation : ndarray, shape (axes, axes), or None
        What acts of the excitations that are recorded; None where it is these.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    ports: tuple[Port, ...]
    blocks: tuple[Block, ...] = ()
    late: str | None = None
    late_outputs: tuple[LateOutput, ...] = ()
    gain_errors: tuple[GainError, ...] = ()
    excitation: FloatArray | None = None

    def closed(self, values: Mapping[str, float]) -> StateSpace:
        """A, B, C, D between inputs and outputs, with a value for each slot; without the nonlinear blocks."""
        inputs, outputs = len(self.inputs), len(self.outputs)
        A, B, C, D = self.closed_with_ports(values)
        return A, B[:, :inputs], C[:outputs], D[:outputs, :inputs]

    def closed_with_ports(self, values: Mapping[str, float]) -> StateSpace:
        """The same from inputs, and what is added to each w, to outputs and each z."""
        inputs, outputs, ports = len(self.inputs), len(self.outputs), len(self.ports)
        delta = np.array([port.scale * values[port.slot] ** port.power for port in self.ports])
        w, z = slice(inputs, inputs + ports), slice(outputs, outputs + ports)
        back = np.eye(ports) - delta[:, None] * self.D[z, w]
        gain, added = np.linalg.solve(back, np.diag(delta)), np.linalg.inv(back)
        C, D = self.C[: outputs + ports], self.D[: outputs + ports]
        to_x, to_y = self.B[:, w] @ gain, D[:, w] @ gain
        return (
            self.A + to_x @ self.C[z],
            np.hstack([self.B[:, :inputs] + to_x @ self.D[z, :inputs], self.B[:, w] @ added]),
            C + to_y @ self.C[z],
            np.hstack([D[:, :inputs] + to_y @ self.D[z, :inputs], D[:, w] @ added]),
        )


class Signal:
    """A linear combination of states, inputs, Delta outputs and injections; adds, subtracts, and scales."""

    __slots__ = ("terms",)

    def __init__(self, terms: Mapping[str, float]) -> None:
        self.terms = dict(terms)

    def __add__(self, other: Signal) -> Signal:
        terms = dict(self.terms)
        for symbol, factor in other.terms.items():
            terms[symbol] = terms.get(symbol, 0.0) + factor
        return Signal(terms)

    def __mul__(self, factor: float) -> Signal:
        return Signal({symbol: factor * own for symbol, own in self.terms.items()} if factor else {})

    __rmul__ = __mul__

    def __neg__(self) -> Signal:
        return self * -1.0

    def __sub__(self, other: Signal) -> Signal:
        return self + -other

    def __truediv__(self, divisor: float) -> Signal:
        return self * (1.0 / divisor)


ZERO = Signal({})


def combine(factors: Iterable[float], signals: Iterable[Signal]) -> Signal:
    """Sum of factors times signals."""
    terms = dict[str, float]()
    for factor, signal in zip(factors, signals, strict=True):
        if factor:
            for symbol, own in signal.terms.items():
                terms[symbol] = terms.get(symbol, 0.0) + factor * own
    return Signal(terms)


class Assembly:
    """Builds an `Lft` from states, inputs, signals and Delta ports.

    A named signal is made by `signal`; whoever uses it gets it with what others add to it by `inject`, before or after.
    """

    def __init__(self) -> None:
        self.states: list[str] = []
        self.inputs: list[str] = []
        self.ports: list[Port] = []
        self.blocks: list[Block] = []
        self._rates: dict[str, Signal] = {}
        self._seen: list[Signal] = []
        self._seen_by_blocks: list[Signal] = []
        self._raw: dict[str, Signal] = {}
        self._injected: dict[str, Signal] = {}

    def copy(self) -> Self:
        """The same so far, to be gone on with; signals are never changed, so that both may hold them."""
        other = copy(self)
        for name, value in vars(self).items():
            if isinstance(value, list | dict):
                setattr(other, name, value.copy())
        return other

    def state(self, name: str) -> Signal:
        """A new state; give its rate by `set_rate`."""
        self.states.append(f"x:{name}")
        return Signal({f"x:{name}": 1.0})

    def set_rate(self, name: str, rate: Signal) -> None:
        """Time derivative of a state."""
        self._rates[f"x:{name}"] = rate

    def lag(self, name: str, source: Signal, slot: str) -> Signal:
        """A new state that follows `source` with the time constant that fills `slot`."""
        state = self.state(name)
        self.set_rate(name, self.port(slot, source - state, power=-1))
        return state

    def input(self, name: str) -> Signal:
        """A new input."""
        self.inputs.append(name)
        return Signal({f"u:{name}": 1.0})

    def port(self, slot: str, z: Signal, *, power: int = 1, scale: float = 1.0) -> Signal:
        """A new entry of Delta that sees `z`; returns its output ``scale value**power z``."""
        symbol = f"w:{len(self.ports)}"
        self.ports.append(Port(slot, power, scale))
        self._seen.append(z)
        return Signal({symbol: 1.0})

    def block(
        self,
        law: str,
        z: Sequence[Signal],
        slots: Mapping[str, str],
        constants: Mapping[str, float] | None = None,
        **shape: Any,
    ) -> Signal:
        """A new nonlinear entry of Delta that sees the one or two signals `z`; returns its output (see `Block`)."""
        symbol = f"b:{len(self.blocks)}"
        self.blocks.append(Block(law, len(z), dict(slots), dict(constants or {}), shape))
        self._seen_by_blocks += z
        return Signal({symbol: 1.0})

    def table(
        self,
        function: Callable[..., ArrayLike],
        z: Sequence[Signal],
        reach: Sequence[float],
        slot: str,
        nodes: int = 201,
    ) -> Signal:
        """A new entry ``g function(z)`` of Delta for a function of your own, tabulated so that it runs in the core.

        Parameters
        ----------
        function : callable
            Takes one array per signal, in SI units, and broadcasts.
        z : sequence of Signal
            One or two signals.
        reach : sequence of float
            The table spans ``-reach .. reach`` of each signal; beyond it the function goes on as a straight line.
        slot : str
            What fills the factor g.
        nodes : int
            Per signal; cubic splines lie between them.
        """
        grids = [np.linspace(-r, r, nodes) for r in reach]
        values = np.asarray(function(*np.meshgrid(*grids, indexing="ij")), dtype=np.float64)
        values = np.ascontiguousarray(np.broadcast_to(values, (nodes,) * len(grids)))
        return self.block(
            "table", z, {"g": slot}, values=values, first=[g[0] for g in grids], spacing=[g[1] - g[0] for g in grids]
        )

    def system(
        self, name: str, matrices: tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike], inputs: Sequence[Signal]
    ) -> list[Signal]:
        """Outputs of a linear system A, B, C, D of your own, driven by signals; `name` names its states."""
        A, B, C, D = (np.atleast_2d(np.asarray(matrix, dtype=np.float64)) for matrix in matrices)
        states = [self.state(f"{name}.{k}") for k in range(len(A))]
        for k in range(len(A)):
            self.set_rate(f"{name}.{k}", combine(A[k], states) + combine(B[k], inputs))
        return [combine(of_x, states) + combine(of_u, inputs) for of_x, of_u in zip(C, D, strict=True)]

    def signal(self, name: str, value: Signal) -> Signal:
        """A new named signal; returns it together with all that is injected into it."""
        self._raw[name] = value
        return self[name]

    def __getitem__(self, name: str) -> Signal:
        return self._raw[name] + Signal({f"j:{name}": 1.0})

    def raw(self, name: str) -> Signal:
        """A named signal without what is injected into it."""
        return self._raw[name]

    def inject(self, name: str, value: Signal) -> None:
        """Add to a named signal wherever it is used."""
        self._injected[name] = self._injected.get(name, ZERO) + value

    def is_changed(self, *names: str) -> bool:
        """Whether anything is injected into one of these signals."""
        return any(name in self._injected for name in names)

    def lft(self, outputs: Sequence[str]) -> Lft:
        """The transformation, with these named signals as outputs."""
        names = [*self.states, *(f"u:{name}" for name in self.inputs)]
        names += [*(f"w:{k}" for k in range(len(self.ports))), *(f"b:{k}" for k in range(len(self.blocks)))]
        column = {symbol: k for k, symbol in enumerate(names)}
        injected = {f"j:{name}": k for k, name in enumerate(self._injected)}

        def rows(signals: Sequence[Signal]) -> tuple[FloatArray, FloatArray]:
            own, of_injections = np.zeros((len(signals), len(names))), np.zeros((len(signals), len(injected)))
            for i, signal in enumerate(signals):
                for symbol, factor in signal.terms.items():
                    if symbol in column:
                        own[i, column[symbol]] += factor
                    elif symbol in injected:
                        of_injections[i, injected[symbol]] += factor
            return own, of_injections

        own, of_injections = rows(list(self._injected.values()))
        eliminated = np.linalg.solve(np.eye(len(injected)) - of_injections, own)
        used = [self._rates[state] for state in self.states] + [self[name] for name in outputs]
        used += self._seen + self._seen_by_blocks
        own, of_injections = rows(used)
        table = own + of_injections @ eliminated
        table[np.abs(table) < 1e-13 * (np.abs(own) + np.abs(of_injections) @ np.abs(eliminated))] = 0.0  # what cancels
        n = len(self.states)
        return Lft(
            A=table[:n, :n],
            B=table[:n, n:],
            C=table[n:, :n],
            D=table[n:, n:],
            inputs=tuple(self.inputs),
            outputs=tuple(outputs),
            ports=tuple(self.ports),
            blocks=tuple(self.blocks),
        )
