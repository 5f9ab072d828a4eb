"""Many identifications at once: the numbers of one by one, on however many threads, and failures as rows."""

import ctypes
import gc
import json
import os
import platform
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ambid
from ambid import _core
from ambid.errors import ModelError, Stopped
from ambid.excitation import prbs
from ambid.identification import identify, identify_many
from ambid.identification import many as many_runs
from ambid.identification.many import fit_for_core
from ambid.identification.minimum import WhitenedProblem
from ambid.identification.problem import Descent
from ambid.model import Model
from ambid.noise import Noise
from hidden.one_axis import ONE_AXIS

ALIKE = 1e-6
"""Difference from one by one, in standard errors."""
AT_BOUND = 1e-4
"""The same where a bound is touched: there a descent ends by its relative step of 1e-8, not by what is left to gain."""
REPEATS_ALIKE = 1e-3
"""The same of repeats, which end by the same test of what a step would gain, at another point within it."""


def experiments(rig, seeds, order=7, hold=4, periods=4, **options):
    """Virtual experiments on a rig, with noise of these seeds."""
    period = (2**order - 1) * hold
    excitation = prbs(order, amplitude=0.1, hold=hold, axes=len(rig.axes), periods=periods)
    model = Model(rig)
    made = (model.virtual_experiment(excitation, seed=seed, **options) for seed in seeds)
    return [replace(record, period=period) for record in made]


def require_same(many, singles, alike=ALIKE):
    for run, single in enumerate(singles):
        values = np.array([p.value for p in single.parameters.values()])
        errors = np.array([p.std_error for p in single.parameters.values()])
        assert np.abs((many.values[run] - values) / errors).max() < alike
        assert np.abs(many.std_errors[run] / errors - 1.0).max() < alike
        assert np.allclose(many.covariances[run] / np.outer(errors, errors), single.correlation, atol=alike)
        assert many.misfit[run] == pytest.approx(single.misfit, rel=1e-9)
        assert (many.status[run], many.reasons[run]) == (single.status, "")
        assert abs(many.evaluations[run] - single.evaluations) <= 2  # theta / scale is not always x


@pytest.mark.parametrize("weights", ["likelihood", "eq9"])
@pytest.mark.parametrize("which", ["one axis", "four axes"])
def test_same_numbers_as_one_by_one(which, weights, demo_rig):
    rig = ONE_AXIS.rig if which == "one axis" else demo_rig
    start = Model(rig)
    start = start.with_values({p.name: 1.05 * p.value for p in start.parameters if p.name.startswith("K_i")})
    records = experiments(rig, range(2))
    singles = [identify(start, record, weights=weights) for record in records]
    require_same(identify_many(start, records, weights=weights), singles)


def test_repeats_of_one_experiment_share_their_way_and_not_their_end():
    records = experiments(ONE_AXIS.rig, range(9), order=6)
    start = Model(ONE_AXIS.rig)
    start = start.with_values({p.name: 1.1 * p.value for p in start.parameters if p.name.startswith("K_i")})
    many = identify_many(start, records, weights="eq9")
    singles = [identify(start, record, weights="eq9") for record in records]
    for run, single in enumerate(singles):
        errors = np.array([p.std_error for p in single.parameters.values()])
        off = many.values[run] - [p.value for p in single.parameters.values()]
        assert np.abs(off / errors).max() < REPEATS_ALIKE
        assert np.abs(many.std_errors[run] / errors - 1.0).max() < REPEATS_ALIKE
        assert many.status[run] == single.status
    assert many.evaluations[1:].sum() < sum(single.evaluations for single in singles[1:])


def test_several_records_a_run_and_a_model_for_each():
    records = experiments(ONE_AXIS.rig, range(4))
    starts = [Model(ONE_AXIS.rig), Model(ONE_AXIS.rig).with_values({"tau_e": 6e-4})]
    runs = [records[:2], records[2:]]
    require_same(identify_many(starts, runs), [identify(*own) for own in zip(starts, runs, strict=True)])


def test_a_subset_within_bounds(demo_rig):
    options = {"free": ["K_i", "tau_e"], "fixed": ["K_i.B_*"], "bounds": {"tau_e": (3.9e-4, 3.98e-4)}}
    start = Model(demo_rig).with_values({"tau_e": 3.95e-4})
    record = experiments(demo_rig, [5])[0]
    many, single = identify_many(start, [record], **options), identify(start, record, **options)
    assert many.names == tuple(single.parameters) == ("K_i.A_zeta", "K_i.A_eta", "tau_e")
    assert many.status == (single.status,) == ("at_bound",)
    require_same(many, [single], AT_BOUND)


def test_a_failure_is_a_row(demo_rig):
    good = experiments(demo_rig, range(2))
    wild = Model(demo_rig).with_values({p.name: 1e-3 * p.value for p in Model(demo_rig).parameters})
    other = replace(good[0], sample_rate=2e4)
    models = [Model(demo_rig), wild, Model(demo_rig), Model(demo_rig)]
    many = identify_many(models, [good[0], good[0], other, good[1]])
    assert many.status == ("converged", "failed", "failed", "converged")
    assert "unstable" in many.reasons[1]
    assert "20000 Hz" in many.reasons[2]
    assert np.isnan(many.values[1:3]).all()
    require_same(identify_many(demo_rig, [good[1]]), [identify(demo_rig, good[1])])
    assert np.isfinite(many.values[[0, 3]]).all()


def test_a_wrong_name_is_no_row(demo_rig):
    with pytest.raises(ModelError, match="K_x"):
        identify_many(demo_rig, experiments(demo_rig, [0]), free=["K_x"])


def test_fewer_models_than_runs(demo_rig):
    with pytest.raises(ModelError, match="1 models"):
        identify_many([demo_rig], experiments(demo_rig, range(2)))


def test_nonlinear_models_go_beside_linear_ones(demo_rig):
    rig = ONE_AXIS.rig
    record = experiments(rig, [1])[0]
    nonlinear = Model(rig).add("force_nonlinearity")
    free = ["K_i", "K_s"]
    many = identify_many([Model(rig), nonlinear], [record, record], free=free)
    require_same(many, [identify(own, record, free=free) for own in (Model(rig), nonlinear)])


def test_ctrl_c_keeps_the_runs_before(monkeypatch):
    monkeypatch.setattr(many_runs, "TOGETHER", 3)
    records = experiments(ONE_AXIS.rig, [0])

    def some():
        yield from records * 7
        raise KeyboardInterrupt

    with pytest.raises(Stopped) as stopped:
        identify_many(ONE_AXIS.rig, some())
    done = stopped.value.result
    assert 1 <= len(done) < 7
    require_same(done, [identify(ONE_AXIS.rig, records[0])] * len(done))


def test_what_the_core_refuses_is_told(golden):
    fit = {"theta": np.ones(2), "free": [0], "scale": np.ones(1), "lower": np.zeros(1), "upper": np.ones(1)}
    with pytest.raises(KeyError):
        _core.fit_all([fit])
    fit |= {"x": np.ones(3), "most": 5, "step": 1e-8}
    (refused,) = _core.fit_all([fit])
    assert isinstance(refused, ModelError)
    golden.holds(str(refused))


SCRIPT = """
import json, sys
import numpy as np
sys.path.insert(0, sys.argv[1])
import ambid
from identification.test_many import experiments
rig = ambid.Rig.load(sys.argv[2])
many = ambid.identify_many(rig, experiments(rig, range(5)))
print(json.dumps([many.values.tolist(), many.std_errors.tolist(), many.misfit.tolist()]))
"""


@pytest.mark.slow
def test_the_same_numbers_on_any_number_of_threads(demo_rig):
    def found(threads):
        environment = {**os.environ, "RAYON_NUM_THREADS": str(threads), "PYTHONPATH": os.pathsep.join(sys.path)}
        call = [sys.executable, "-c", SCRIPT, str(Path(__file__).parents[1]), str(demo_rig.path)]
        return json.loads(subprocess.run(call, env=environment, check=True, capture_output=True).stdout)

    assert found(1) == found(3)


def test_results_are_tables(demo_rig):
    many = ambid.identify_many(demo_rig, experiments(demo_rig, range(2)))
    table = many.table()
    assert len(table["tau_e"]) == len(table["reason"]) == len(many) == 2
    assert f"{len(many)} runs" in str(many)


class Allocated(ctypes.Structure):
    """What glibc tells of its heaps, its `mallinfo2` [bytes]."""

    _fields_ = (
        ("heaps", ctypes.c_size_t * 4),
        ("mapped", ctypes.c_size_t),
        ("fast", ctypes.c_size_t * 2),
        ("used", ctypes.c_size_t),
        ("kept", ctypes.c_size_t * 2),
    )


def in_use():
    """Bytes that are allocated, not what the allocator keeps beside them."""
    gc.collect()
    tell = ctypes.CDLL(None).mallinfo2
    tell.restype = Allocated
    found = tell()
    return found.used + found.mapped


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver() < ("glibc", "2.33"), reason="needs glibc's mallinfo2")
def test_memory_does_not_grow():
    model = Model(ONE_AXIS.rig)
    (record,) = experiments(ONE_AXIS.rig, [0], order=6)
    problem = WhitenedProblem(model, Noise(model, [record]))
    limits = np.zeros(len(model.names)), np.full(len(model.names), np.inf)
    fit = fit_for_core(Descent(problem, 1.05 * model.theta / problem.scale, limits, 100))

    def after(runs):
        identify_many(model, (record for _ in range(runs)))
        for _ in range(runs):
            _core.fit_all([fit] * 10)
        return in_use()

    before = after(40)
    assert after(40) - before < 10 * record.y.nbytes  # of 440 fits


def test_the_core_can_be_interrupted():
    (record,) = experiments(ONE_AXIS.rig, [0], order=6)
    model = Model(ONE_AXIS.rig)
    problem = WhitenedProblem(model, Noise(model, [record]))
    limits = np.zeros(len(model.names)), np.full(len(model.names), np.inf)
    fits = [fit_for_core(Descent(problem, 1.05 * model.theta / problem.scale, limits, 100))] * 20_000

    def interrupt(*_):
        raise KeyboardInterrupt

    handler = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            _core.fit_all(fits)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
