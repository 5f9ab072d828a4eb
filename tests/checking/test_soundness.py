"""The page and the JSON of a check, and its figures of the loop against algebra."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ambid.checking import check
from ambid.checking.soundness import ResponseFigures
from reference.loop_rigs import RIGS

from .test_slips import TURNED, bench_experiment, with_gains


def test_figures_of_the_page_are_read_as_they_are(golden):
    pair = "y.A_zeta / i_e.A_zeta"
    noisy = ResponseFigures("noisy", 9, (1.0, 99.0), ("y.A_zeta",), ("i_e.A_zeta",), {pair: 1.1})
    golden.holds(noisy.line())
    assert "e+" not in noisy.line()
    found = check(bench_experiment()[0])
    centred = replace(found, loop=replace(found.loop, open_loop_unstable=()))
    golden.holds(str(centred).splitlines()[2])


def test_the_page_and_its_json(golden):
    rig, record = bench_experiment()
    soundness = check(rig, [record, replace(record, name="turned", y=record.y[:, TURNED])])
    page = str(soundness)
    assert len(page.splitlines()) < 50
    golden.holds(page)
    data = json.loads(json.dumps(soundness.to_json(), allow_nan=False))
    assert data["is_sound"] is False
    assert data["findings"] == [own.as_dict() for own in soundness.findings]
    assert data["findings"][0]["severity"] == "error"
    assert data["findings"][0]["where"]["record"] == "turned"
    assert data["loop"]["mass"] == pytest.approx(69.0, rel=1e-3)
    assert len(data["records"]) == 2
    json.dumps(check(with_gains(rig, proportional=0.3)).to_json(), allow_nan=False)


def test_the_former_name_of_errors_warns():
    rig, _ = bench_experiment()
    soundness = check(with_gains(rig, proportional=0.3))
    with pytest.warns(DeprecationWarning, match="Soundness.errors"):
        assert soundness.faults == soundness.errors


def test_figures_of_the_loop():
    """A mass on one axis: the unstable pole and the peak sensitivity follow from one line of algebra."""
    rig = RIGS["analog, one axis"]
    figures = check(rig).loop
    (bearing,) = rig.bearings
    assert figures.mass == pytest.approx(2.0)
    assert figures.open_loop_unstable == pytest.approx([np.sqrt(bearing.force_displacement[0] / 2.0)])
    f = np.geomspace(1.0, 4000.0, 20000)
    s, pid = 2j * np.pi * f, rig.controller
    K = pid.proportional + pid.integral / s + pid.derivative * s / (pid.derivative_time_constant * s + 1)
    lags = (1 + s * rig.amplifier.time_constant) * (1 + s * rig.actuator.time_constant)
    G = bearing.force_current[0] / lags / (2.0 * s**2 - bearing.force_displacement[0])
    S = np.abs(1 / (1 + K * G))
    assert figures.peak_sensitivity == pytest.approx(S.max(), rel=1e-3)
    assert figures.peak_sensitivity_hz == pytest.approx(f[S.argmax()], rel=0.02)
