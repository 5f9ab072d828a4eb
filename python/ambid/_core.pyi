"""The Rust core. `ambid.loop` and `ambid.identify` give it names and units; use those."""

from collections.abc import Mapping, Sequence
from typing import Literal, NotRequired, TypedDict, TypeVar, final, type_check_only

import numpy as np
from numpy.typing import NDArray

from ambid.errors import ModelError, UnstableLoopError

__all__ = [
    "ClosedLoop",
    "Data",
    "LineData",
    "Scatter",
    "Sources",
    "Stepper",
    "fit_all",
    "instructions",
    "inverses",
    "line_equations",
    "local_regressions",
    "normal_equations",
    "through",
    "way_back",
    "whitening",
    "whittle",
]

_Vector = NDArray[np.float64]
_Matrix = NDArray[np.float64]
_Lines = NDArray[np.complex128]
_Matrices = tuple[_Matrix, _Matrix, _Matrix, _Matrix]

class _DigitalController(TypedDict):
    matrices: _Matrices
    reads: NotRequired[_Matrix | None]
    hidden: NotRequired[int]
    takes: NotRequired[_Matrix | None]
    delay: float
    late: NotRequired[int | None]
    steps: int
    excitation: NotRequired[_Matrix | None]
    errors: NotRequired[Sequence[tuple[int, _Matrix, _Matrix, _Matrix]]]

class _Block(TypedDict):
    law: Literal["force_law", "limit", "bouc_wen", "stop", "table", "polynomial"]
    curve: NotRequired[Literal["unsaturated", "power", "tanh", "root_unsaturated", "root_power"]]
    parameters: NotRequired[Mapping[str, int | None]]
    constants: NotRequired[Mapping[str, float]]
    values: NotRequired[NDArray[np.float64]]
    first: NotRequired[Sequence[float]]
    spacing: NotRequired[Sequence[float]]
    exponents: NotRequired[Sequence[Sequence[int]]]

@final
class ClosedLoop:
    def __new__(
        cls,
        matrices: _Matrices,
        gains: list[tuple[int, float, int]],
        parameters: int,
        dt: float,
        controller: _DigitalController | None = None,
        blocks: Sequence[_Block] = ...,
        substeps: int | None = None,
        late: Sequence[tuple[int, int, float]] = ...,
    ) -> ClosedLoop: ...
    @property
    def inputs(self) -> int: ...
    @property
    def outputs(self) -> int: ...
    @property
    def parameters(self) -> int: ...
    @property
    def parts(self) -> int: ...
    def packed(
        self, theta: _Vector, inputs: Sequence[str], outputs: Sequence[str], parameters: Sequence[str]
    ) -> bytes: ...
    def poles(self, theta: _Vector) -> NDArray[np.complex128]: ...
    def discrete(self, theta: _Vector) -> _Matrices: ...
    def shifts(self, theta: _Vector) -> list[int]: ...
    def discrete_slopes(self, theta: _Vector, free: list[int]) -> NDArray[np.float64]: ...
    def simulate(self, theta: _Vector, u: _Matrix) -> _Matrix: ...
    def sensitivity(self, theta: _Vector, free: list[int], u: _Matrix) -> tuple[_Matrix, NDArray[np.float64]]: ...
    def folded(
        self, theta: _Vector, free: list[int], u: _Matrix, first: int, period: int, last: float = 1.0
    ) -> tuple[_Matrix, NDArray[np.float64]]: ...
    def settled(
        self, theta: _Vector, free: list[int], u: _Matrix, period: int
    ) -> tuple[_Matrix, NDArray[np.float64]]: ...
    def free_response(self, theta: _Vector, d: _Vector, length: int, samples: int) -> _Matrix: ...
    def transfer(self, theta: _Vector, w: _Lines) -> _Lines: ...
    def lines(
        self, theta: _Vector, free: list[int], w: _Lines, u: _Lines, d: _Vector | None = None, basis: bool = True
    ) -> tuple[_Lines, _Lines, _Lines]: ...

@final
class Data:
    def __new__(cls, system: ClosedLoop, u: _Matrix, z: _Matrix, weights: _Vector, first: int = 0) -> Data: ...

@final
class LineData:
    def __new__(cls, system: ClosedLoop, w: _Lines, u: _Lines, z: _Lines, whitening: _Lines) -> LineData: ...
    def rows(
        self,
        system: ClosedLoop,
        theta: _Vector,
        free: list[int],
        d: _Vector | None = None,
        transients: bool = True,
    ) -> _Matrix: ...

@final
class Scatter:
    def __new__(cls, lines: _Lines, used: NDArray[np.bool_]) -> Scatter: ...
    def between(
        self, low: NDArray[np.uintp], high: NDArray[np.uintp], left_out: NDArray[np.uintp] | None = None
    ) -> _Lines: ...

_Of = TypeVar("_Of", LineData, Data)
_Groups = list[tuple[ClosedLoop, list[_Of]]]

@type_check_only
class Records(TypedDict):
    lines: NotRequired[_Groups[LineData]]
    samples: NotRequired[_Groups[Data]]

@type_check_only
class Fit(Records):
    theta: _Vector
    free: list[int]
    scale: _Vector
    lower: _Vector
    upper: _Vector
    x: _Vector
    prior: NotRequired[_Vector]
    enough: NotRequired[float]
    numbers: NotRequired[float]
    witnesses: NotRequired[float]
    most: int
    step: float

@type_check_only
class Ended(TypedDict):
    theta: _Vector
    status: Literal["converged", "at_bound", "max_evaluations"]
    evaluations: int
    hessian: _Matrix
    gradient: _Vector
    cost: float
    transients: list[_Vector]
    slopes: list[_Matrix]
    fitted: list[int]

@final
class Stepper:
    def __new__(cls, system: ClosedLoop, theta: _Vector) -> Stepper: ...
    def step(self, u: _Vector) -> _Vector: ...
    def run(self, u: _Matrix) -> _Matrix: ...
    def reset(self) -> None: ...

def normal_equations(
    system: ClosedLoop, theta: _Vector, free: list[int], records: list[Data]
) -> tuple[_Matrix, _Vector, _Vector]: ...
def line_equations(
    system: ClosedLoop, theta: _Vector, free: list[int], records: list[LineData], near: Sequence[_Vector] = ...
) -> tuple[_Matrix, _Vector, float, list[_Vector], list[_Matrix], list[int]]: ...
def fit_all(fits: list[Fit]) -> list[Ended | ModelError | UnstableLoopError]: ...
def instructions() -> Literal["avx2", "baseline"]: ...
def local_regressions(
    lines: _Lines,
    excitation: _Lines,
    weighted: Sequence[tuple[int, _Vector]],
    starts: NDArray[np.uintp],
    nearest: NDArray[np.uintp],
    width: int,
    degree: int,
    most_taken: float,
) -> tuple[_Lines, _Matrix]: ...

@final
class Sources:
    def __new__(cls, ways: _Lines, first: NDArray[np.uintp], weights: _Matrix, splines: int) -> Sources: ...
    def likely(self, lines: _Lines, coefficients: _Matrix, usual: float) -> tuple[float, _Matrix, _Matrix]: ...
    def fitted(self, coefficients: _Matrix, variance: _Matrix) -> _Vector: ...
    def whitening(self, coefficients: _Matrix) -> _Lines: ...

def whitening(covariance: _Lines, back: _Lines) -> tuple[_Lines, _Lines]: ...
def whittle(covariance: _Lines, lines: _Lines) -> float: ...
def inverses(matrices: _Lines) -> _Lines: ...
def through(matrices: _Lines, lines: _Lines) -> _Lines: ...
def way_back(system: ClosedLoop, theta: _Vector, w: _Lines, inputs: list[int], channels: int) -> _Lines: ...
