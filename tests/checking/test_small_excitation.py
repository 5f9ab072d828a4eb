"""An excitation that is too small beside the reference to be detected has no wrong sign."""

import numpy as np

from ambid import Record, check
from ambid.checking.controller import fit_controller
from ambid.checking.lines import Lines
from ambid.checking.nominal import NominalLoop
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 1000.0, (300.0, 900.0, 12.0)
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)


def test_it_is_not_judged():
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    rig = TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital", "reference": True} | matrices)
    r = np.tile(1e-4 * np.random.default_rng(3).standard_normal(500), 8)
    signals = TRUTH.run(RATE, pid(*GAINS, RATE), r, 0.0 * r, noise=(1e-6, 1e-4))
    signals = {name: signals[name] for name in ("y", "i_c")} | {"r": r[:, None]}
    nothing = np.tile(1e-6 * np.random.default_rng(4).standard_normal(500), 8)[:, None]

    def record(i_e: np.ndarray) -> Record:
        return Record.from_arrays(**signals, i_e=i_e, sample_rate=RATE, axes=rig.axes, rig=rig)

    scale = fit_controller(NominalLoop(rig), Lines.of(record(nothing))).scale[0, 0]
    turned = record(-scale * nothing)
    fit = fit_controller(NominalLoop(rig), Lines.of(turned))
    assert abs(fit.scale[0, 0] + 1.0) < 0.3
    assert fit.std_error[0, 0] > 0.1
    assert check(rig, [turned]).is_sound
