"""The lines of a record with its transient: exact wherever a record is cut, and a misfit of one however it is taken."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ambid import Model, Rig, compare, identify, prbs
from ambid.diagnosis import rank
from ambid.effects import find
from ambid.noise.chance import misfit_bound
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from hidden.bench import simulate
from hidden.long import LONG
from hidden.one_axis import ONE_AXIS
from places import LEVITATOR
from tiers import first_fast


def cut(record, first, samples):
    part = slice(first, first + samples)
    return replace(record, i_e=record.i_e[part], y=record.y[part], i_c=record.i_c[part])


@pytest.mark.parametrize(
    ("first", "samples"), [(0, 2040), (1, 1020), (100, 1530), (333, 2040), (909, 1024), (1364, 1700), (2040, 1100)]
)
@pytest.mark.parametrize("period", [510, None], ids=["periods", "no periods"])
def test_a_noise_free_record_cut_anywhere_is_met(bench, first, samples, period):
    """With the transient taken out, all lines; without it, a hundredth of the largest and more would be left."""
    i_e = prbs(8, amplitude=0.15, hold=2, axes=4, periods=8)
    (clean,) = bench.records(i_e, [0], period=period, sensor_noise=0.0, current_noise=0.0)
    noise = np.random.default_rng(0).standard_normal((samples, 8)) * [*[1e-9] * 4, *[1e-4] * 4]
    part = cut(clean, first, samples)
    noisy = replace(part, y=part.y + noise[:, :4], i_c=part.i_c + noise[:, 4:])
    exact = Model(bench.rig())
    own = RecordLines(exact, Measured(noisy))
    own.measured_lines = own.judged_lines(part.outputs)  # what was measured without noise, weighed by it
    left = np.abs(own.residual_lines(exact)).max(axis=0)
    assert np.all(left < 1e-9 * np.abs(own.measured_lines).max(axis=0))
    settled = np.abs(own.measured_lines - own.judged_lines(exact.response(part))).max(axis=0)
    assert first == 0 or np.all(settled > 1e-3 * np.abs(own.measured_lines).max(axis=0))


def test_the_response_in_time_is_that_of_the_lines(bench):
    """Of a noisy record that is cut, simulated with its transient, only white noise is left."""
    i_e = prbs(8, amplitude=0.15, hold=2, axes=4, periods=6)
    (record,) = bench.records(i_e, [3], period=510, sensor_noise=1e-12, current_noise=1e-9)
    part = cut(record, 444, 4 * 510 + 77)
    (own,) = compare(Model(bench.rig()), part).records
    assert own.simulated.shape == (part.samples, 8)
    assert_allclose(own.residual[:, :4], 0.0, atol=1e-3 * part.y.std())
    assert_allclose(own.residual[-77:, 4:], 0.0, atol=1e-3 * part.i_c.std())


def test_neither_offsets_nor_a_mean_of_the_excitation_matter(bench, run):
    exact = Model(bench.rig())
    own = compare(exact, run).cost
    lifted = replace(run, y=run.y + 1e-4, i_c=run.i_c - 3.0)
    assert_allclose(compare(exact, lifted).cost, own, rtol=1e-9)


@pytest.mark.parametrize(("machine", "seeds"), first_fast([("four_bearings", [0]), ("eight_bearings", [0])], 0))
def test_many_channels_in_three_periods_have_a_misfit_of_one_and_usable_scores(machine, seeds):
    """16 and 32 channels: two settled periods leave one unexcited line to each excited one."""
    own = LONG[machine]
    axes = len(own.rig.axes)
    for seed in seeds:
        i_e = prbs(8, amplitude=own.amplitude, hold=3, axes=axes, periods=3, seed=seed)
        records = [
            simulate(own.rig, i_e, hidden, seed=seed, period=765, **own.truth, **own.noise)
            for hidden in ({}, {"loop_delay": {"seconds": 2e-5}})
        ]
        assert records[0].outputs.shape[1] == 2 * axes
        right, late = (identify(own.rig, record) for record in records)
        assert right.misfit == pytest.approx(1.0, abs=0.05)
        assert right.is_adequate
        catalogue = [find("loop_delay"), find("seal_forces")]
        assert min(c.p_value for c in rank(right.comparison, catalogue).candidates) > 1e-4
        best = rank(late.comparison, catalogue).candidates[0]
        assert (best.effect.name, best.p_value < 1e-9) == ("loop_delay", True)
        assert best.start["delay"] == pytest.approx(2e-5, rel=0.2)


@pytest.mark.parametrize(("order", "hold", "dof"), first_fast([(5, 2, 117), (6, 2, 245)]))
def test_the_right_model_is_within_the_bound_of_a_short_record(order, hold, dof):
    """Of 12 seeds none is above a bound that chance passes once in a thousand."""
    rig = ONE_AXIS.rig.replace(
        controller=ONE_AXIS.rig.controller.model_copy(update={"implementation": "digital", "delay_samples": 1.0})
    )
    truth = Model(rig).with_values({"K_i.A_zeta": 185.0, "K_s.A_zeta": 1.18e6, "tau_e": 2.85e-4})
    misfits = []
    for seed in range(12):
        i_e = prbs(order, amplitude=1.0, hold=hold, periods=6, seed=seed)
        record = simulate(rig, i_e, seed=seed, period=hold * (2**order - 1), **ONE_AXIS.truth)
        comparison = compare(truth, record)
        assert comparison.dof == pytest.approx(dof, rel=0.1)
        assert comparison.misfit < comparison.bound
        assert comparison.bound == misfit_bound(comparison.dof)
        misfits.append(comparison.misfit)
    assert np.mean(misfits) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 * 1.5**2 / dof / 12))


def test_a_nonlinear_model_meets_a_record_cut_anywhere():
    model = Model(ONE_AXIS.rig).add("force_nonlinearity")
    i_e = prbs(8, amplitude=1.0, hold=4, periods=6)
    record = replace(model.virtual_experiment(i_e, sensor_noise=5e-8, current_noise=5e-3, seed=1), period=1020)
    part = cut(record, 1333, 4 * 1020)
    assert compare(model, part).misfit == pytest.approx(1.0, abs=0.08)
    assert compare(Model(ONE_AXIS.rig), part).misfit > 2.0


def test_a_delay_of_whole_samples_has_poles():
    """Two samples of an analog loop make equal poles, at which the usual way to a Schur form may not end."""
    rig = Rig.load(LEVITATOR).replace(sample_rate=2e4)
    model = Model(rig).add("loop_delay", {"delay": 1e-4})
    i_e = 0.5 * np.random.default_rng(105).standard_normal((8000, 1))
    record = model.virtual_experiment(i_e, sensor_noise=1e-7, current_noise=1e-2, seed=5)
    assert compare(model, record).misfit == pytest.approx(1.0, abs=0.1)
