"""Controllers as the rig file describes them, and their state space.

What is given is K from the displacements y [m] to currents [A], or to voltages [V] of a voltage-driven coil; the loop
applies the minus: i_ref = -(K y) + i_e. With a reference it acts on y - r, and it may read further recorded signals
beside y.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator
from pydantic_core import InitErrorDetails

from ambid.arrays import StateSpace
from ambid.errors import RigError
from ambid.rig.fields import LARGEST_VALUE, MILLISECONDS, NOTHING, Range, Spec, per_axis, plain, problem, refuse
from ambid.rig.realisation import (
    Matrix,
    added,
    as_state_space,
    companion,
    has_shape,
    per_axis_polynomials,
    pid,
    sizes,
    stack,
    tustin,
    wrong_counts,
)

SAMPLE_RATE = Range(1.0, 1e6, "Hz", (("kilohertz", 1e3),))
_SIGN = "the loop applies the minus: i_ref = -(K y) + i_e"
PROPORTIONAL = Range(0.0, 1e9, "A/m, or V/m with amplifier.resistance", (), _SIGN)
INTEGRAL = Range(0.0, 1e12, "A/(m s), or V/(m s) with amplifier.resistance", (), _SIGN)
DERIVATIVE = Range(0.0, 1e7, "A s/m, or V s/m with amplifier.resistance", (), _SIGN)
FILTER_TIME_CONSTANT = Range(1e-7, 0.1, "s", (MILLISECONDS,))
MOST_STATES = 200
"""States of a controller given as matrices: the time that poles take grows by the cube of their number."""
MOST_COEFFICIENTS = 61
"""Coefficients of a polynomial: from order 20 or so on its roots move by more than themselves with its last digits, and
beyond order 60 nothing is left of them."""
READABLE = ("y", "i_c", "r")
"""Recorded signals that a controller may read."""
PID_GAINS = ("proportional", "integral", "derivative")


class Controller(Spec, ABC):
    """Base of the controllers.

    Parameters
    ----------
    implementation : {"analog", "digital"}
        Digital: y is sampled at `sample_rate`, and the output is held over the sample.
    delay_samples : float
        Digital only: delay of the sum -(K y) + i_e, from reading y to the output, in its samples; may be fractional. A
        command may be recorded before it or behind it.
    sample_rate : float, optional
        Digital only: rate of the controller [Hz], a whole multiple of the rig's; the rig's if absent.
    reference : bool
        Whether it acts on y - r, the error to the recorded reference r [m], in place of y.
    """

    implementation: Literal["analog", "digital"] = Field(description="'analog' or 'digital'")
    delay_samples: Annotated[float, Range(0.0, 100.0, "samples")] = 0.0
    sample_rate: Annotated[float, SAMPLE_RATE] | None = None
    reference: bool = Field(False, strict=True, description="true or false, without quotes")

    @model_validator(mode="after")
    def _digital_keys(self) -> "Controller":
        if self.implementation == "analog":
            given = {"delay_samples": self.delay_samples, "sample_rate": self.sample_rate}
            text = "not allowed with implementation = 'analog'; remove the key, or write implementation = 'digital'."
            refuse(*(problem(text, value, key) for key, value in given.items() if value))
        return self

    @property
    def is_digital(self) -> bool:
        """Whether it runs in samples."""
        return self.implementation == "digital"

    @property
    def signals(self) -> tuple[str, ...]:
        """Recorded signals that it reads, in the order of its columns: all axes of the first, then of the next."""
        return ("y",)

    @property
    def follows_reference(self) -> bool:
        """Whether r drives it, as y - r or as a column of its own."""
        return self.reference or "r" in self.signals

    def rate(self, sample_rate: float) -> float:
        """Sample rate of a digital controller [Hz], on a rig that records at `sample_rate` [Hz]."""
        return sample_rate if self.sample_rate is None else self.sample_rate

    @abstractmethod
    def state_space(self, n_axes: int, sample_rate: float) -> StateSpace:
        """State space of K, from `signals` of all axes to currents of all axes [A], without delay and minus.

        Parameters
        ----------
        n_axes : int
            Number of axes of the rig.
        sample_rate : float
            Of the rig [Hz]; an analog controller does not need it.

        Returns
        -------
        A, B, C, D : ndarray, shapes (n, n), (n, signals n_axes), (n_axes, n), (n_axes, signals n_axes)
            In continuous time if analog, otherwise in discrete time at `rate(sample_rate)`.
        """

    @property
    def gains(self) -> tuple[str, ...]:
        """Names of the gains that K is linear in, and that are not zero: ``gain`` where only the whole of K is."""
        return ("gain",)

    def part_of(self, gain: str, n_axes: int, sample_rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """What a gain brings to C and D of `state_space`; ``gain`` is all of them, and one that K has not brings 0."""
        *_, c, d = self.state_space(n_axes, sample_rate)
        return (c, d) if gain == "gain" else (0.0 * c, 0.0 * d)

    @abstractmethod
    def axis_problems(self, n_axes: int) -> list[InitErrorDetails]:
        """Problems of a controller that does not fit a rig of `n_axes` axes; empty if it fits."""

    def rig_problems(self, n_axes: int, sample_rate: float) -> list[InitErrorDetails]:
        """Problems of this controller on a rig of `n_axes` axes that records at `sample_rate` [Hz]."""
        problems = self.axis_problems(n_axes)
        multiple = self.rate(sample_rate) / sample_rate
        if multiple < 0.5 or abs(multiple - round(multiple)) > 1e-6:
            text = f"expected a whole multiple of the rig's sample_rate = {sample_rate:g} Hz; or leave the key out."
            problems.append(problem(text, self.sample_rate, "sample_rate"))
        return problems

    @staticmethod
    def from_lti(system: Any, delay_samples: float = 0.0) -> "StateSpaceController | TransferFunctionController":
        """Take over a linear time-invariant system of python-control or SciPy.

        Parameters
        ----------
        system : object
            K, from y [m] to current [A]. Has `A`, `B`, `C`, `D`, or `num`, `den`, or `to_ss()`; and `dt`:
            None or 0 is analog, a number is the sampling time of a digital controller [s].
            A system with one input and one output is repeated on every axis.
        delay_samples : float
            As in `Controller`, for a digital system.

        Raises
        ------
        RigError
            If it is no such system, such as a measured frequency response, or its sampling time is not given as a
            number.
        """
        dt = getattr(system, "dt", None)
        if dt is True:
            raise RigError("controller: dt = True: expected the sampling time in s; give the system a number as dt.")
        keys: dict[str, Any] = {"implementation": "analog", "delay_samples": delay_samples}
        if dt:
            keys |= {"implementation": "digital", "sample_rate": 1.0 / dt}
        if not hasattr(system, "A") and not hasattr(system, "num") and hasattr(system, "to_ss"):
            system = as_state_space(system)
        if all(hasattr(system, key) for key in "ABCD"):
            return StateSpaceController(A=system.A, B=system.B, C=system.C, D=system.D, **keys)
        if hasattr(system, "num") and hasattr(system, "den"):
            keys["numerator"] = per_axis_polynomials(system.num, may_couple=False)
            keys["denominator"] = per_axis_polynomials(system.den, may_couple=True)
            return TransferFunctionController(**keys)
        raise RigError(
            f"controller: {type(system).__name__} object: expected a linear system with A, B, C, D or num, den; "
            "convert it with control.ss or scipy.signal.StateSpace."
        )


class PidController(Controller):
    """The same PID on every axis, P + I/s + D s/(T s + 1); digital: by Tustin's rule at the controller's rate.

    Parameters
    ----------
    proportional : float or sequence of float
        P [A/m], or [V/m] where `Amplifier.resistance` says that the controller commands a voltage; a number for all
        axes, or one per axis.
    integral : float or sequence of float
        I [A/(m s)] or [V/(m s)], likewise.
    derivative : float or sequence of float
        D [A s/m] or [V s/m], likewise.
    derivative_time_constant : float or sequence of float
        T [s]; needed where D is not zero.
    """

    kind: Literal["pid"] = "pid"
    proportional: Annotated[float | tuple[float, ...], per_axis(PROPORTIONAL)] = Field(
        description=f"{PROPORTIONAL.allowed}, a number or one per axis"
    )
    integral: Annotated[float | tuple[float, ...], per_axis(INTEGRAL)] = 0.0
    derivative: Annotated[float | tuple[float, ...], per_axis(DERIVATIVE)] = 0.0
    derivative_time_constant: Annotated[float | tuple[float, ...], per_axis(FILTER_TIME_CONSTANT)] | None = None

    @model_validator(mode="after")
    def _filtered(self) -> "PidController":
        if np.any(self.derivative) and self.derivative_time_constant is None:
            text = f"the derivative needs it; expected {FILTER_TIME_CONSTANT.allowed}."
            refuse(problem(text, NOTHING, "derivative_time_constant"))
        return self

    def axis_problems(self, n_axes: int) -> list[InitErrorDetails]:
        """See `Controller.axis_problems`."""
        names = ("proportional", "integral", "derivative", "derivative_time_constant")
        given = {key: getattr(self, key) for key in names}
        return wrong_counts({key: value for key, value in given.items() if isinstance(value, tuple)}, n_axes)

    def state_space(self, n_axes: int, sample_rate: float) -> StateSpace:
        """See `Controller.state_space`; one state per axis and gain I, D that is not zero."""
        return self._with_outputs(PID_GAINS, n_axes, sample_rate)

    @property
    def gains(self) -> tuple[str, ...]:
        """See `Controller.gains`."""
        return tuple(gain for gain in PID_GAINS if np.any(getattr(self, gain)))

    def part_of(self, gain: str, n_axes: int, sample_rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Controller.part_of`."""
        *_, c, d = self._with_outputs(PID_GAINS if gain == "gain" else (gain,), n_axes, sample_rate)
        return c, d

    def _with_outputs(self, shown: Sequence[str], n_axes: int, sample_rate: float) -> StateSpace:
        """The state space with only these gains in C and D."""
        time_constant = 0.0 if self.derivative_time_constant is None else self.derivative_time_constant
        values = (self.proportional, self.integral, self.derivative, time_constant)
        factors = [float(gain in shown) for gain in PID_GAINS]
        axes = zip(*(np.broadcast_to(value, n_axes) for value in values), strict=True)
        system = stack([pid(p, i, d, t, factors) for p, i, d, t in axes])
        return tustin(system, 1.0 / self.rate(sample_rate)) if self.is_digital else system


class _ReadingController(Controller, ABC):
    """Base of those that may read more than y.

    Parameters
    ----------
    inputs : sequence of {"y", "i_c", "r"}
        Recorded signals that its columns stand for, signal by signal, all axes each: ["y", "i_c"] for state feedback
        with the measured current. A column of r is for a law that does not act on y - r alone.
    """

    inputs: tuple[Literal["y", "i_c", "r"], ...] = Field(
        ("y",), min_length=1, description=f"a list of names of recorded signals, out of {', '.join(READABLE)}"
    )

    @field_validator("inputs")
    @classmethod
    def _once_each(cls, inputs: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(inputs)) < len(inputs) or "y" not in inputs:
            refuse(problem("expected 'y', and every other signal at most once.", inputs))
        return inputs

    @property
    def signals(self) -> tuple[str, ...]:
        """See `Controller.signals`."""
        return self.inputs


class StateSpaceController(_ReadingController):
    """Any linear controller, x' = A x + B u, K u = C x + D u; digital: the discrete matrices at its rate.

    Parameters
    ----------
    A : (n, n) array_like
        Left out, with B and C, for a constant gain.
    B : (n, k m) array_like
        m is the number of axes, in the rig's order, and k that of `inputs`; m = 1 is repeated on every axis.
    C : (m, n) array_like
    D : (m, k m) array_like
    """

    kind: Literal["state_space"] = "state_space"
    A: Matrix = Field((), max_length=MOST_STATES, description=f"a matrix, n rows of n numbers, n up to {MOST_STATES}")
    B: Matrix = Field((), description="a matrix, n rows with one number per axis")
    C: Matrix = Field((), description="a matrix, one row of n numbers per axis")
    D: Matrix = Field(min_length=1, description="a matrix, one row per axis with one number per axis")

    @model_validator(mode="after")
    def _shapes_agree(self) -> "StateSpaceController":
        states, axes = sizes(self.A, self.B, self.C, self.D, len(self.inputs))
        read = axes * len(self.inputs)
        shapes = {"A": (states, states), "B": (states, read), "C": (axes, states), "D": (axes, read)}
        others = {"A": "B and C", "B": "A and D", "C": "A and D", "D": "B and C"}
        refuse(
            *(
                problem(
                    f"expected {shape[0]} rows of {shape[1]} numbers, to fit {others[key]}.", getattr(self, key), key
                )
                for key, shape in shapes.items()
                if not has_shape(getattr(self, key), shape)
            )
        )
        return self

    def axis_problems(self, n_axes: int) -> list[InitErrorDetails]:
        """See `Controller.axis_problems`."""
        return wrong_counts({"D": self.D}, n_axes)

    def state_space(self, n_axes: int, sample_rate: float) -> StateSpace:
        """See `Controller.state_space`."""
        n, m = len(self.A), len(self.D)
        read = m * len(self.inputs)
        a, b = np.reshape(self.A, (n, n)), np.reshape(self.B, (n, read))
        c, d = np.reshape(self.C, (m, n)), np.reshape(self.D, (m, read))
        return stack([(a, b, c, d)] * (n_axes // m), len(self.inputs))


class TransferFunctionController(_ReadingController):
    """Proper transfer functions, one on each axis; polynomials in s, or in z if digital, highest power first.

    Parameters
    ----------
    numerator, denominator : sequence of float, or one such sequence per axis
        A single polynomial stands for all axes; kept as a tuple of polynomials. With several `inputs`: one for all, one
        per signal, or one per signal and axis, all axes of the first signal first.
    """

    kind: Literal["transfer_function"] = "transfer_function"
    numerator: Matrix = Field(min_length=1, description="a list of coefficients, or one such list per axis")
    denominator: Matrix = Field(min_length=1, description="a list of coefficients, or one such list per axis")

    @field_validator("numerator", "denominator", mode="before")
    @classmethod
    def _one_per_axis(cls, value: Any) -> Any:
        single = isinstance(value, list | tuple) and value and not isinstance(value[0], list | tuple | np.ndarray)
        rows = (value,) if single else value
        return (
            [r.tolist() if isinstance(r, np.ndarray) else r for r in rows] if isinstance(rows, list | tuple) else value
        )

    @model_validator(mode="after")
    def _proper(self) -> "TransferFunctionController":
        for key in ("numerator", "denominator"):
            text = f"expected at most {MOST_COEFFICIENTS} coefficients, found {{}}; give a high order as state space."
            rows = enumerate(getattr(self, key))
            refuse(*(problem(text.format(len(r)), r, key, k) for k, r in rows if len(r) > MOST_COEFFICIENTS))
        count = max(len(self.numerator), len(self.denominator))
        sides = {"numerator": self.numerator, "denominator": self.denominator}
        n_axes, odd = divmod(count, len(self.inputs)) if count > 1 else (1, 0)
        if odd:
            text = f"expected 1 entry, or a multiple of {len(self.inputs)}, one per signal in inputs; found {count}."
            refuse(problem(text, count, "numerator"))
        refuse(*wrong_counts(sides, n_axes, len(self.inputs)))
        problems = [
            problem("expected a coefficient that is not 0.", row, "denominator", k)
            for k, row in enumerate(self.denominator)
            if not any(row)
        ]
        refuse(*problems)
        for k, (numerator, denominator) in enumerate(self._pairs(n_axes)):
            if len(numerator) > len(denominator):
                text = f"expected degree {len(denominator) - 1} at most, that of the denominator; improper: "
                text += "filter the derivative, or divide by one more pole."
                problems.append(problem(text, tuple(numerator.tolist()), "numerator", k))
            first = abs(denominator[0])
            for key, row in (("numerator", numerator), ("denominator", denominator)):
                if max(map(abs, row), default=0.0) > LARGEST_VALUE * min(first, 1.0):
                    text = (
                        f"expected numbers of at most {plain(LARGEST_VALUE)} over {first:g}, the denominator's first."
                    )
                    problems.append(problem(text, tuple(row.tolist()), key, k))
        refuse(*problems)
        return self

    def _pairs(self, n_axes: int) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Numerator and denominator of each signal and axis, without leading zeros."""
        sides = []
        for rows in (self.numerator, self.denominator):
            own = [np.trim_zeros(np.array(row, dtype=float), "f") for row in rows]
            every = own * len(self.inputs) if len(own) == 1 else own
            sides.append([row for row in every for _ in range(n_axes * len(self.inputs) // len(every))])
        return list(zip(*sides, strict=True))

    def axis_problems(self, n_axes: int) -> list[InitErrorDetails]:
        """See `Controller.axis_problems`."""
        sides = {"numerator": self.numerator, "denominator": self.denominator}
        return wrong_counts(sides, n_axes, len(self.inputs))

    def state_space(self, n_axes: int, sample_rate: float) -> StateSpace:
        """See `Controller.state_space`; the realisation is a balanced companion form."""
        pairs = self._pairs(n_axes)
        own = [[companion(*pair) for pair in pairs[axis::n_axes]] for axis in range(n_axes)]
        return stack([added(systems) for systems in own], len(self.inputs))


AnyController = Annotated[
    PidController | StateSpaceController | TransferFunctionController, Field(discriminator="kind")
]
