"""Two effects at once against an independent simulation: what one does, the next does to what the first made of it."""

import numpy as np
import pytest

from ambid import prbs
from ambid.effects import find
from hidden.bench import simulate
from hidden.families import BENCHES

from .test_effects import AGREE, at_truth, largest_error

BENCH = BENCHES["bench"]
READING = ("foundation_resonance", "sensor_position_error", "sensor_misalignment", "sensor_gain_error", "sensor_lag")
"""What becomes of a displacement, from the rotor to the record."""
CURRENT = ("loop_delay", "back_emf", "amplifier_bandwidth", "amplifier_voltage_limit", "eddy_currents")
"""What becomes of a command, from the controller to the flux."""
PAIRS = [
    *((first, second) for own in (READING, CURRENT) for k, first in enumerate(own) for second in own[k + 1 :]),
    ("foundation_resonance", "back_emf"),
    ("sampling_skew", "amplifier_voltage_limit"),
    ("sampling_skew", "sensor_gain_error"),
    ("axis_cross_coupling", "eddy_currents"),
    ("axis_cross_coupling", "sensor_misalignment"),
]
BESIDE = 5.0
"""Times the errors of both alone that the error of a pair may be."""
CORNER = {("amplifier_bandwidth", "amplifier_voltage_limit"): 12.0}
"""The limit's corner is rounded, which a second-order amplifier feels more."""


def given(name):
    """What is hidden, and our parameters of it."""
    hidden, values, _ = AGREE[name]
    if name == "sensor_misalignment":
        values = {key: np.deg2rad(value) for key, value in values.items()}
    return hidden, {p.name: values.get(p.name, 0.0) for p in find(name).parameters(BENCH.rig)}


@pytest.fixture(scope="module")
def error_of():
    """Of so many effects, relative to the peak of a signal; each set is simulated once."""
    i_e = prbs(8, amplitude=1.0, hold=3, axes=4, periods=1)
    known = {}

    def found(*names):
        if names not in known:
            own = {name: given(name) for name in names}
            model = at_truth(BENCH.rig)
            for name, (_, values) in own.items():
                model = model.add(name, values)
            hidden = {name: hidden for name, (hidden, _) in own.items()}
            truth = simulate(BENCH.rig, i_e, hidden, seed=None, **BENCH.truth)
            known[names] = largest_error(model.simulate(i_e), truth)
        return known[names]

    return found


@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_pairs_act_one_after_the_other(error_of, pair):
    alone = sum(error_of(name) for name in pair)
    assert error_of(*pair) < CORNER.get(pair, BESIDE) * alone + 1e-9
    assert error_of(*reversed(pair)) == pytest.approx(error_of(*pair), rel=0.05, abs=1e-9), "whatever is added first"
