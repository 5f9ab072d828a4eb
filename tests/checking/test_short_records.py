"""Records without periods, of any length: noise that only the recorder has is no fault of rig or record."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Record, check, identify
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 10_000.0, (12_000.0, 200_000.0, 18.0)
TRUTH = Levitator(mass=4.0, K_i=115.0, K_s=4e5, tau=3e-4)


def rig(factor=1.0):
    matrices = pid_matrices(*(factor * own for own in GAINS), RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices, off=0.02)


def record(samples, seed, loud=1.0):
    """Random steps, read with noise that the controller has not, as loud in y as the response to them."""
    rng = np.random.default_rng([seed, samples])
    i_e = np.repeat(rng.choice([-0.1, 0.1], samples), 3)[:samples]
    found = TRUTH.run(RATE, pid(*GAINS, RATE), 0.0 * i_e, i_e)
    noise = {"y": loud * 1e-6, "i_c": loud * 0.01}
    own = {name: found[name] + size * rng.standard_normal(found[name].shape) for name, size in noise.items()}
    return Record.from_arrays(**own, i_e=i_e[:, None], sample_rate=RATE, axes=["A_zeta"])


QUIET = {"period_not_found", "no_excited_lines", "few_excited_lines", "few_periods", "excitation_doubtful"}
"""No faults; noise as loud as the response may let a short excitation be doubted, which is a warning."""
SHORT = [60, 120, 199, 400, 900]


@pytest.mark.parametrize("samples", SHORT)
@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(own, marks=pytest.mark.slow) for own in range(2, 12))])
def test_noise_of_the_recorder_is_no_fault(samples, seed):
    found = check(rig(), record(samples, seed))
    assert {own.code for own in found.findings if own.where.record and own.severity != "note"} <= QUIET


def of_another(own, seed):
    """The same record with an excitation of the same kind that did not drive it."""
    other = np.repeat(np.random.default_rng([7, seed]).choice([-0.1, 0.1], own.samples), 3)[: own.samples, None]
    return replace(own, i_e=other)


@pytest.mark.parametrize("with_i_c", [True, False])
@pytest.mark.parametrize(("samples", "loud"), [(199, 3.0), (199, 30.0), (900, 30.0), (3000, 30.0)])
def test_where_noise_hides_the_response_no_excitation_is_that_of_another_record(samples, loud, with_i_c):
    """Whether it is right or not; it may be doubted."""
    for seed in range(3):
        own = record(samples, seed, loud)
        own = own if with_i_c else replace(own, i_c=None)
        for tried in (own, of_another(own, seed)):
            assert not [found.code for found in check(rig(), tried).findings if found.severity == "error"]


@pytest.mark.parametrize(("samples", "loud"), [(900, 1.0), (900, 3.0), (3000, 3.0)])
def test_an_excitation_of_another_record_is_told_where_the_response_would_show(samples, loud):
    for seed in range(3):
        own = record(samples, seed, loud)
        (found,) = check(rig(), of_another(own, seed)).errors
        assert found.code == "foreign_excitation"
        assert not check(rig(), own).errors


@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_gain_is_still_found(seed):
    found = check(rig(factor=1.3), record(6000, seed, loud=0.3))
    (gains,) = [own for own in found.findings if own.code == "gains_differ"]
    assert gains.severity == "error"
    assert gains.values["factors"]["K"] == pytest.approx(1.0 / 1.3, rel=0.05)


@pytest.mark.parametrize("samples", range(9, 24, 3))
def test_a_record_of_a_few_samples_determines_little_and_stops_nothing(samples):
    own = record(samples, 3)
    assert check(rig(), own).is_sound
    found = identify(rig(), own)
    errors = [own.std_error for own in found.parameters.values()]
    assert found.directions or all(
        error > 0.1 * abs(own.value) for own, error in zip(found.parameters.values(), errors, strict=True)
    )


def test_the_interval_of_few_samples_holds_the_truth():
    found = identify(rig(), record(199, 5))
    own = found["K_i.A_zeta"]
    assert abs(own.value - TRUTH.K_i) < 4.0 * own.std_error
    assert own.std_error < 0.2 * TRUTH.K_i
