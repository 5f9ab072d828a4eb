"""The judged lines of one record with the noise on them, as its spectrum is estimated: between the lines of an
excitation that repeats, else from what follows neither the excitation nor a transient.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from ambid import _core
from ambid.arrays import ComplexArray, FloatArray
from ambid.loop.effect import Tone
from ambid.model import Model
from ambid.noise.colour import back_through_loop
from ambid.noise.in_time import InTime
from ambid.noise.judged import FEW, JudgedLines
from ambid.noise.local import beside_excitation, likelier_beside_excitation
from ambid.noise.measured import Measured
from ambid.noise.shape import heard
from ambid.noise.unexcited import Unexcited
from ambid.noise.whitener import HALF_WIDTH, Spectrum, require_noise, whitened


class NoisyLines(JudgedLines):
    """The judged lines of one record, and the noise on them.

    Parameters
    ----------
    model : Model
        Its loop shapes the noise, and its transient is no noise.
    measured : Measured
    tones : sequence of Tone
        The lines around them, and around the frequencies of effects in the model, are judged beside the excited ones.
    rough : bool
        Few lines, the noise of one channel not separated from another's: good enough to come near an optimum.
    angles : mapping of str to float
        By which waves of effects, by name, are turned in this record [rad].
    unexcited : Unexcited, optional
        The lines that the noise of a record with periods is taken from, as they are known of the same model; by default
        as if the controller heard all of it.

    Attributes
    ----------
    unexcited : Unexcited
    spectrum : Spectrum
    """

    def __init__(
        self,
        model: Model,
        measured: Measured,
        tones: Sequence[Tone] = (),
        *,
        rough: bool = False,
        angles: Mapping[str, float] | None = None,
        unexcited: Unexcited | None = None,
    ) -> None:
        super().__init__(model, measured, tones, rough=rough, angles=angles or {})
        self.unexcited = Unexcited(self._base, measured) if unexcited is None else unexcited
        ways = self.judged_lines, self.lines_of_period
        self._in_time = InTime(self.record, self.window, *ways, measured.folded, are_between=len(self.more) > 0)
        way = self._rough if rough else self._between if self.window.is_periodic else self._without_periods
        self.spectrum = way()

    @property
    def noise_is_measured(self) -> bool:
        """Whether there are lines that are not excited."""
        return self.window.is_periodic

    @property
    def numbers(self) -> int:
        """Real numbers that are judged: 2 p per line."""
        return 2 * self.measured_lines.size

    judged = numbers

    @property
    def whitening(self) -> ComplexArray:
        """`Spectrum.whitening`."""
        return self.spectrum.whitening

    @property
    def spreads(self) -> FloatArray:
        """`Spectrum.spread` of every number."""
        return np.repeat(self.spectrum.spread, 2 * self.measured.channels)

    @property
    def whitened_measured(self) -> FloatArray:
        """What was measured on the judged lines."""
        return self.whiten(self.measured_lines)

    def whiten(self, lines: ComplexArray) -> FloatArray:
        """Judged lines of shape (lines, p) or (lines, p, q), whitened, as real numbers."""
        return whitened(self.whitening, lines)

    def noise_power(self) -> FloatArray:
        """Power of the noise of each channel on the judged lines, shape (lines, p), in units of the lines."""
        inverse = _core.inverses(self.whitening)
        own = 2.0 * np.sum(np.abs(inverse) ** 2, axis=2)
        return np.asarray(own / self.spectrum.raised[:, None])

    @property
    def alone(self) -> FloatArray:
        """Hotelling's factor (n_l - 1)/n_l of a channel by itself, of every line, shape (lines, 1)."""
        share = 1.0 - 1.0 / self.spectrum.raised  # p / n_l
        return np.asarray(1.0 - share / self.measured.channels)[:, None]

    @property
    def constant_responses(self) -> FloatArray:
        """Whitened responses, in and out of phase, that are the same at every frequency, shape (numbers, 2 p).

        To what drives the axes together as on the loudest line.
        """
        drive = self.drive @ self.drive[self.loudest].conj()
        lines = drive[:, None, None] * np.eye(self.measured.channels)
        return self.whiten(np.concatenate([lines, 1j * lines], axis=2))

    def _rough(self) -> Spectrum:
        """The noise of each sensor and reading by itself."""
        window = self.window.settled
        if not window.is_periodic:
            return Spectrum.of(*self._beside_excitation())
        index = window.between(-(-FEW // len(self.window.excited)))
        power = uniform_filter1d(np.abs(self.unexcited.left(index)) ** 2, 2 * HALF_WIDTH + 1, axis=0, mode="nearest")
        place, judged = index / window.periods, self.index / self.window.periods
        own = np.stack([np.interp(judged, place, channel) for channel in power.T], axis=1)
        alone = (own[:, :, None] * np.eye(self.measured.channels)).astype(complex)
        return Spectrum.of(alone, self.unexcited.back(self.points), np.ones(len(own)))

    def _beside_excitation(self) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """The noise of each channel by itself, from what follows neither the model nor, smoothly, the excitation."""
        window, p, here = self.window, self.measured.channels, self._base
        points, excitation = window.points(window.excited), here.excitation(self.record)
        inputs = np.ascontiguousarray(window.excited_lines(excitation))
        several = [self.measured.excited]
        if here.is_linear:
            response, _, _ = here.loop.core.lines(here.theta, [], points, inputs, None, False)
            several.append(self.measured.excited - response[:, :p])
        tries = beside_excitation(several, self._as_one(inputs[:, : here.loop.driven], points))
        found = min(tries, key=lambda own: own.log_determinant)
        power = np.diagonal(found.spectrum, axis1=1, axis2=2).real[:: self._every]
        as_recorded = np.tile(np.eye(p, dtype=complex), (len(power), 1, 1))
        return (power[:, :, None] * np.eye(p)).astype(complex), as_recorded, np.ones(len(power))

    def _between(self) -> Spectrum:
        """The noise, from lines that are not excited."""
        covariance, spread = self.unexcited.around(self.tones).covariance(self.index / self.window.periods)
        back = self.unexcited.back(self.points)
        covariance = self._with_noise_of_i_e(self._with_rounding(covariance, back), back)
        require_noise(covariance, back, self.measured_lines)
        raised = 1.0 + self.unexcited.shape.unsure(self.points)
        return Spectrum.of(covariance * raised[:, None, None], back, spread * raised)

    def _with_noise_of_i_e(self, covariance: ComplexArray, back: ComplexArray) -> ComplexArray:
        """The noise with what the model answers to noise in the measurement of i_e, which the machine did not hear."""
        power, here = self.unexcited.unheard(self.index), self._base
        if power is None:
            return covariance
        way = here.loop.transfer(here.theta, self.points)[:, : self.measured.channels, : len(self.record.axes)]
        way = back @ way
        return np.asarray(covariance + way @ power @ way.conj().transpose(0, 2, 1))

    def _with_rounding(self, covariance: ComplexArray, back: ComplexArray) -> ComplexArray:
        """The noise with what the converters round, which a digital controller acts on, too."""
        rounding = self.measured.rounding
        way = np.array(back)
        if self._base.rig.controller.is_digital and self.record.y.size:
            read = heard(self._base, self.measured.channels)
            way[:, :, :read] = np.eye(self.measured.channels)[:, :read]
        return np.asarray(covariance + (way * rounding) @ way.conj().transpose(0, 2, 1))

    def _without_periods(self) -> Spectrum:
        """The noise, from what follows neither the excitation nor a transient."""
        here, p = self._base, self.measured.channels
        shapes = [np.tile(np.eye(p, dtype=complex), (len(self.points), 1, 1))]
        for currents_are_read in (True, False) if "i_c" in here.rig.controller.signals else (True,):
            shapes.append(back_through_loop(here, self.points, p, currents_are_read=currents_are_read))
        if not here.is_linear:
            response, _ = self._in_time.lines(here, [], at_rest=True)
            residual = self._without_tones(self.measured_lines - response)
            found = likelier_beside_excitation(residual, self.drive, shapes)
            return Spectrum.of(*found, np.ones(len(self.points)))
        core, inputs, transient = here.loop.core, self._inputs(here), None
        for _ in range(2):  # the first time with a transient that is as smooth as it may be
            response, _, _ = core.lines(here.theta, [], self.points, inputs, transient, False)
            residual = self._without_tones(self.measured_lines - response[:, :p])
            found = likelier_beside_excitation(residual, self.drive, shapes)
            require_noise(*found[:2], self.measured_lines)
            spectrum = Spectrum.of(*found, np.ones(len(self.points)))
            data = _core.LineData(core, self.points, inputs, self.measured_lines, spectrum.whitening)
            transient = _core.line_equations(core, here.theta, [], [data])[3][0]
        return spectrum
