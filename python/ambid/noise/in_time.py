"""The response of a nonlinear model to the excitation of one record, simulated in time and transformed.

The periodic steady state is what remains after a lead of so many periods that a start from rest is forgotten. What is
left of it looks like a transient of the loop linearised at rest, which is fitted with every model. From the steady
state of that loop the lead is shorter; exact enough where responses are compared. Where the record itself begins at
rest, its first periods are simulated as they were, until they repeat.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.model import Model
from ambid.noise.window import Window
from ambid.record import Record

SETTLED = 1e-3
"""Part of a transient that may be left where a nonlinear model that started from rest counts as settled."""
NEARLY = 0.1
"""The same where it started from the steady state of the linearised loop, and likes are compared."""
AT_A_TIME = 30_000_000
"""Numbers of derivatives over all samples that are held at a time, and that are kept."""
NEUTRAL = 1e-5
"""Rate of decay below which a state does not return to rest [1/s]: what sticks creeps at a tenth of it."""
REMEMBERED = 8
"""Responses that are kept."""

Lines = tuple[ComplexArray, ComplexArray]
"""Judged lines of a response, shape (lines, p), and of its derivatives, shape (lines, p, free)."""


class _Key(NamedTuple):
    core: _core.ClosedLoop
    theta: bytes
    at_rest: bool


Folded = dict[_Key, tuple[list[int], FloatArray, FloatArray]]
"""Parameters, and a response with its derivatives by them, added up over the periods."""


class InTime:
    """Simulates nonlinear models over one record.

    Parameters
    ----------
    record : Record
    window : Window
    judged : callable
        The judged lines of a signal that starts with the record.
    of_period : callable
        The same of a signal that repeats, from its sum over the periods.
    folded : dict, optional
        Where the last responses of the record are kept, which do not depend on its noise.
    are_between : bool
        Whether lines between the excited ones are judged too: there stands what a start from rest leaves.
    """

    def __init__(
        self,
        record: Record,
        window: Window,
        judged: Callable[[FloatArray], ComplexArray],
        of_period: Callable[[FloatArray], ComplexArray],
        folded: Folded | None = None,
        *,
        are_between: bool = False,
    ) -> None:
        self.record, self.window, self.judged, self.of_period = record, window, judged, of_period
        self.are_between = are_between
        self._folded: Folded = {} if folded is None else folded
        self.channels = len(record.channels)
        self._known: dict[_Key, ComplexArray] = {}

    def __getstate__(self) -> dict[str, Any]:
        """All but what was simulated by compiled loops."""
        return {**self.__dict__, "_folded": {}, "_known": {}}

    def lines(self, here: Model, free: list[int], *, at_rest: bool) -> Lines:
        """Judged lines of the response, from rest or settled, and of its derivatives by the parameters in `free`."""
        key = _Key(here.loop.core, here.theta.tobytes(), at_rest)
        if not free and key in self._known:
            return self._known[key], np.zeros((*self._known[key].shape, 0), dtype=complex)
        response, slopes = self._lines(here, free, at_rest=at_rest)
        if not free or here.structure.substeps is not None:  # else derivatives choose the substeps too
            self._known[key] = response
        while len(self._known) > REMEMBERED:
            self._known.pop(next(iter(self._known)))
        return response, slopes

    def nearly(self, here: Model, free: list[int]) -> Lines:
        """The same of a settled response after a short lead, for comparison with that of a like model.

        The parameters in `free` are those of nonlinear effects alone.
        """
        lead = self._samples_until(here, NEARLY)
        if not self._repeats(here) or lead >= self.window.samples or here.decay_rate < -NEUTRAL:
            return self.lines(here, free, at_rest=False)
        period = self.window.period
        inputs = np.take(self._mean_period(here), np.arange(-lead, period), axis=0, mode="wrap")
        y, slopes = here.loop.core.settled(here.theta, free, inputs, period)
        return self._of_period(self.window.periods * y), self._of_period(self.window.periods * slopes)

    def from_rest(self, here: Model, free: list[int]) -> Lines:
        """The same of a model that rests when the record begins, all samples simulated."""
        return self._one_by_one(here, free, self._inputs(here))

    def samples(self, here: Model, *, at_rest: bool) -> FloatArray:
        """The response in all samples of the record, shape (samples, p)."""
        inputs = np.ascontiguousarray(here.excitation(self.record))
        if at_rest or inputs.shape[1] > here.loop.driven:
            return here.loop.core.simulate(here.theta, inputs)[:, : self.channels]
        lead = self._lead(here) * self.window.period
        before = np.resize(inputs[: self.window.period], (lead, inputs.shape[1]))
        return here.loop.core.simulate(here.theta, np.vstack([before, inputs]))[lead:, : self.channels]

    def _lines(self, here: Model, free: list[int], *, at_rest: bool) -> Lines:
        if not self._repeats(here) or (at_rest and self.are_between):
            return self.from_rest(here, free)
        key = _Key(here.loop.core, here.theta.tobytes(), at_rest)
        found = self._folded.get(key)
        # derivatives choose the substeps too, unless these are given
        is_derived = found is not None and not free and here.structure.substeps is not None
        if found is None or (found[0] != free and not is_derived):
            found = (free, *self._added_up(here, free, at_rest=at_rest))
            if found[2].size <= AT_A_TIME:
                self._folded[key] = found
            # responses that are kept with their derivatives, for whatever noise the record is next judged in
            while len(self._folded) > 2:
                self._folded.pop(next(iter(self._folded)))
        _, y, slopes = found
        return self._of_period(y), self._of_period(slopes[:, :, : len(free)])

    def _added_up(self, here: Model, free: list[int], *, at_rest: bool) -> tuple[FloatArray, FloatArray]:
        """The response and its derivatives, added up over the periods."""
        window, core, theta, lead = self.window, here.loop.core, here.theta, self._lead(here)
        if at_rest:
            periods = min(lead + 1, window.periods)
            own = self._inputs(here)[: window.first + periods * window.period]
            return core.folded(theta, free, own, window.first, window.period, window.periods - periods + 1.0)
        own = np.tile(self._mean_period(here), (lead + 1, 1))
        return core.folded(theta, free, own, lead * window.period, window.period, float(window.periods))

    def _one_by_one(self, here: Model, free: list[int], inputs: FloatArray) -> Lines:
        """Of a response that need not repeat, with so many derivatives at a time as fit into memory."""
        core, theta = here.loop.core, here.theta
        together = max(1, AT_A_TIME // (inputs.shape[0] * core.outputs))
        response, found = None, []
        for first in range(0, max(1, len(free)), together):
            y, slopes = core.sensitivity(theta, free[first : first + together], inputs)
            response = self.judged(y[:, : self.channels]) if response is None else response
            found.append(self.judged(slopes[:, : self.channels]))
        assert response is not None, "there is a group"
        return response, np.concatenate(found, axis=2)

    def _repeats(self, here: Model) -> bool:
        """Whether all that acts on the loop repeats with the excitation."""
        return self.window.is_periodic and here.loop.core.inputs == here.loop.driven

    def _inputs(self, here: Model) -> FloatArray:
        return np.ascontiguousarray(here.excitation(self.record)[: self.window.first + self.window.samples])

    def _mean_period(self, here: Model) -> FloatArray:
        """What repeats of the inputs: all of them, unless i_e was measured with noise."""
        inputs, window = self._inputs(here)[self.window.first :], self.window
        first = inputs[: window.period]
        if (inputs[-window.period :] == first).all():
            return first
        return np.ascontiguousarray(inputs.reshape(window.periods, window.period, -1).mean(axis=0))

    def _of_period(self, folded: FloatArray) -> ComplexArray:
        return self.of_period(folded[:, : self.channels])

    def _lead(self, here: Model) -> int:
        """Periods from rest after which a transient of the model does not matter."""
        return int(np.clip(-(-self._samples_until(here, SETTLED) // self.window.period), 1, self.window.periods))

    def _samples_until(self, here: Model, left: float) -> int:
        """Samples after which so much of a transient is left; no more than the record has.

        What stays as it is, such as the flux of a hysteresis, is none.
        """
        rates = -here.loop.core.poles(here.theta).real
        decay = float(np.min(rates[rates > NEUTRAL], initial=np.inf))
        return int(min(np.ceil(np.log(1.0 / left) / decay * self.record.sample_rate), self.window.samples))
