"""Records that nothing drives: how a loop comes to rest identifies it, and rest shows nothing."""

import numpy as np

from ambid import Record, Rig, check, identify
from ambid.diagnosis import diagnose
from ambid.diagnosis.ranking import UNDRIVEN
from ambid.errors import RecordError
from found import codes
from reference.levitator import Levitator, pid, pid_matrices

RATE, GAINS = 1000.0, (300.0, 900.0, 12.0)
TRUTH = Levitator(mass=0.06, K_i=1.3, K_s=95.0, tau=0.005)
RELEASED = 100
"""Sample at which a push is over: what was before it is cut off."""


def rig() -> Rig:
    matrices = pid_matrices(*GAINS, RATE)
    matrices |= {key: [row[:1] for row in matrices[key]] for key in ("B", "D")}
    return TRUTH.rig(RATE, {"kind": "state_space", "implementation": "digital"} | matrices, off=0.1)


def released(push: float, seed: int = 1) -> dict[str, np.ndarray]:
    i_e = np.zeros(1600)
    i_e[:RELEASED] = push
    found = TRUTH.run(RATE, pid(*GAINS, RATE), 0.0 * i_e, i_e, noise=(1e-6, 1e-4), seed=seed)
    return {name: own[RELEASED:] for name, own in found.items() if name != "i_ref"} | {"i_e": i_e[RELEASED:, None]}


def record(push: float = 0.05, **keys) -> Record:
    own = rig()
    return Record.from_arrays(**released(push, **keys), sample_rate=RATE, axes=own.axes, rig=own)


def test_it_is_fitted_and_the_intervals_hold_the_truth():
    estimate = identify(rig(), record())
    assert estimate.is_adequate
    assert estimate.status == "converged"
    for name, true in (("K_i.A_zeta", TRUTH.K_i), ("K_s.A_zeta", TRUTH.K_s)):
        found = estimate.parameters[name]
        assert found.std_error < 0.1 * true
        assert abs(found.value - true) < 4.0 * found.std_error


def test_a_note_says_so_and_check_has_no_fault():
    own = record()
    assert "free_response" in codes(own)
    assert check(rig(), [own]).is_sound


def test_a_diagnosis_tries_no_effect_and_says_why():
    found = diagnose(rig(), record())
    assert found.verdict == "adequate"
    assert found.to_json()["not_tried"]["loop_delay"] == UNDRIVEN.message


def test_a_misfit_is_told_though_nothing_can_be_named():
    own = rig().replace(amplifier={"time_constant": 0.012})
    run = Record.from_arrays(**released(0.05), sample_rate=RATE, axes=own.axes, rig=own)
    found, estimate = diagnose(own, run), identify(own, run)
    assert (found.verdict, estimate.is_adequate) == ("not_informative", False)
    assert estimate.inconsistency in found.findings
    assert "records_not_driven" in {own.code for own in found.findings}


def test_noise_alone_is_still_refused(golden):
    with golden.raises(RecordError):
        record(push=0.0)


def test_it_is_no_response_to_anything(golden):
    with golden.raises(RecordError):
        record().frequency_response()


def test_coming_to_rest_is_no_path_through_operating_points():
    assert not any(finding.code == "operating_point_drift" for finding in check(rig(), [record()]).findings)
