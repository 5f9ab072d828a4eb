"""Fits that sharp resonances or the edge of stability keep from their optimum: found where all is damped more."""

from dataclasses import dataclass

import numpy as np
import pytest

from ambid import Record, Rig, compare, prbs
from ambid.identification import identify
from ambid.identification.damped import damped_start
from ambid.identification.minimum import refit
from ambid.identification.problem import ROUGHLY
from ambid.identification.renewal import around_edge
from ambid.model import Model
from hidden.bench import measured
from hidden.families import BENCHES

BENCH = BENCHES["bench"]


@dataclass(frozen=True)
class Kind:
    """Records of the bench with light modes, turning and under a digital controller.

    Attributes
    ----------
    damping : tuple of float
        Of the bending modes.
    order, hold, periods : int
        Of the PRBS.
    more : dict
        Noise, as the simulator takes it.
    """

    damping: tuple[float, ...]
    order: int
    hold: int
    periods: int
    more: dict

    def rig(self) -> Rig:
        """What is known."""
        rotor = BENCH.rig.rotor.model_copy(update={"modal_damping": self.damping})
        controller = BENCH.rig.controller.model_copy(update={"implementation": "digital"})
        return BENCH.rig.replace(rotor=rotor, controller=controller, speed=400.0)

    def record(self, seed: int) -> Record:
        """One draw of excitation and noise."""
        rig = self.rig()
        i_e = prbs(self.order, amplitude=1.0, hold=self.hold, axes=len(rig.axes), periods=self.periods, seed=seed)
        return measured(rig, i_e, {}, seed=seed, **BENCH.truth, **self.more)


LIKELY = 1.3
"""J/dof below which a right model is at its optimum: of records of 0.06 s it scatters by a tenth."""
SHARE, HELD = 0.875, 0.85
"""Least shares of the fits that end there, and of the 95 % intervals that hold the truth."""
STEP = 2.0 * BENCH.rig.bearings[0].air_gap / 2**13
KINDS = {
    # modes narrower than the lines are apart: from the rig's values the fit runs into the edge of stability
    "sharp modes": Kind((0.003, 0.001), 8, 4, 3, {"colour": ([1.0], [1.0, -1.7, 0.96])}),
    # 0.06 s, in which modes decay so slowly that the likeliest loop of records that fade is unstable
    "edge of stability": Kind((0.003, 0.003), 5, 1, 20, {"adc_step": STEP, "sensor_noise": 0.6 * STEP}),
}


def is_at_edge_of(found) -> bool:
    """Whether its slowest mode hardly decays during the record."""
    (own,) = found.comparison.noise.records
    return found.model.decay_rate * own.samples / own.sample_rate < 0.01


@pytest.mark.parametrize("seeds", [2, pytest.param(10, marks=pytest.mark.slow)], ids="{} seeds".format)
@pytest.mark.parametrize("kind", KINDS)
def test_an_optimum_beyond_sharp_modes_is_found_from_nominal_values(kind, seeds):
    rig = KINDS[kind].rig()
    found = [identify(rig, KINDS[kind].record(seed)) for seed in range(seeds)]
    assert all(own.model.is_stable for own in found)
    assert sum(own.misfit < LIKELY for own in found) >= SHARE * seeds
    truth = dict(zip(Model(rig).names, (*BENCH.K_i, *BENCH.K_s, BENCH.tau_e), strict=True))
    intervals = [(truth[name], p.ci95) for own in found for name, p in own.parameters.items() if p.ci95 is not None]
    assert np.mean([low < value < high for value, (low, high) in intervals]) > HELD
    # what is near a limit says so, on whichever side of it a draw is
    for own in found:
        if is_at_edge_of(own):
            assert {"near_edge_of_stability", "stopped_at_edge_of_stability"} & {one.code for one in own.findings}


@pytest.mark.parametrize("kind", KINDS)
def test_a_refit_that_stopped_at_the_edge_of_stability_goes_around_it(kind):
    """From nominal values alone it ends where J is tens of times that of the noise, and more."""
    fit = refit(compare(Model(KINDS[kind].rig()), KINDS[kind].record(0)), step=ROUGHLY)
    assert fit.misfit > 10.0
    assert around_edge(fit).misfit < LIKELY
    assert around_edge(fit, bound=-4.0 * fit.cost) is fit  # it promises to end above that


def test_a_start_whose_modes_fade_during_the_record_is_at_no_edge():
    """What promises much there is no fit yet, and goes on by itself."""
    record = measured(BENCH.rig, BENCH.excitation(BENCH.amplitude, 0), {}, seed=0, **BENCH.truth, **BENCH.noise)
    begun = compare(Model(BENCH.rig), record)
    assert begun.misfit > 10.0
    assert around_edge(begun) is begun


@pytest.mark.parametrize("seed", range(3))
def test_a_start_far_off_leads_near_the_optimum(seed):
    record = measured(BENCH.rig, BENCH.excitation(BENCH.amplitude, seed), {}, seed=seed, **BENCH.truth, **BENCH.noise)
    model = Model(BENCH.rig)
    far = model.with_values(
        {name: 1.25 * model.theta[model.names.index(name)] for name in model.names if "K_s" in name}
    )
    assert far.is_stable
    free = list(range(len(model.names)))
    x, evaluations = damped_start(far, [record], free, (np.zeros(len(free)), np.full(len(free), np.inf)))
    nearest = identify(model, record).model.theta / [p.scale for p in far.parameters]
    assert evaluations > 0
    np.testing.assert_allclose(x, nearest, rtol=0.02)
