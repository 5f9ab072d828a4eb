"""What a step of the search may not bring."""

import numpy as np
import pytest

from ambid import Model, compare, diagnose
from ambid.diagnosis.search import rings_on
from hidden.bench import simulate
from hidden.dirt import MARGIN, NOISE_FREE, soiled
from hidden.experiment import experiment
from hidden.families import BENCHES
from hidden.sizes import sized


@pytest.mark.parametrize(("damping", "rings"), [(1e-4, True), (1e-3, True), (0.02, False)])
def test_a_mode_that_outlasts_the_record_stands_in_for_a_tone(damping, rings):
    """Of 2.05 s; at 10 Hz, a mode with a damping of 0.001 decays by a tenth of e in it."""
    rig, (train,), _, _ = experiment(None)
    base = compare(Model(rig), train)
    values = {"frequency_hz": 10.0, "damping": damping, "inverse_mass": 1e-9}
    better = base.of(base.model.add("foundation_resonance", values))
    assert rings_on(base, better) is rings


def test_a_hysteresis_is_no_mode():
    """Linear at rest, its states would last for ever."""
    rig, (train,), _, _ = experiment(None)
    base = compare(Model(rig), train)
    better = base.of(base.model.add("magnetic_hysteresis", {"share": 0.05, "inverse_width": 4.0}))
    assert not rings_on(base, better)


@pytest.mark.slow
def test_without_any_noise_nothing_is_left():
    """Of this record the cost of the right model is zero in all digits."""
    bench = BENCHES["bench"]
    one = bench.excitation(bench.amplitude, 2)[: bench.period]
    i_e = np.take(one, np.arange(-MARGIN, bench.periods * bench.period + MARGIN), axis=0, mode="wrap")
    hidden = {"seal_forces": sized("seal_forces", "clear").parameters}
    record = simulate(bench.rig, i_e, hidden, period=bench.period, seed=None, **bench.truth)
    found = diagnose(bench.rig, soiled(record, NOISE_FREE, np.random.default_rng(2), bench.rig))
    assert found.effects == ("seal_forces",)
    assert found.history[-1].misfit < 1e-9
