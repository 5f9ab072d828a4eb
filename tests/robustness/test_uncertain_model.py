"""The uncertain model: closed again it is the loop, whatever the parameters; its files are read by Octave."""

import shutil
import subprocess

import control
import numpy as np
import pytest
import scipy.io
import scipy.signal
from numpy.testing import assert_allclose

import ambid
from ambid.errors import ModelError
from ambid.loop.delay import ORDER, pade
from ambid.loop.response import frequency_response
from ambid.model import Model
from places import LEVITATOR

F = np.geomspace(0.5, 4000.0, 60)


def known(model, share=0.02):
    """The model with parameters that are known to a share, all but the first effect's."""
    return model.with_covariance(np.diag((share * model.theta) ** 2))


@pytest.fixture(scope="module")
def analog(demo_rig):
    model = Model(demo_rig.replace(speed=200.0)).add("seal_forces", {"direct_stiffness": 4e5})
    return known(model.add("loop_delay", {"delay": 1e-4}).add("sensor_lag"))


@pytest.fixture(scope="module")
def digital(demo_rig):
    keys = {"implementation": "digital", "delay_samples": 0.3}
    return known(Model(demo_rig.replace(controller=demo_rig.controller.model_copy(update=keys), speed=200.0)))


def values_of(model):
    random = np.random.default_rng(0)
    return [model.theta, *(model.theta * (1.0 + 0.02 * random.standard_normal((3, len(model.theta)))))]


def test_closed_again_an_analog_loop_is_the_loop(analog):
    own = ambid.uncertain(analog)
    at = analog.names.index("loop_delay.delay")
    for theta in values_of(analog):
        late = 2j * np.pi * F * theta[at]
        exact = np.exp(-late) / control.ss(*pade(ORDER), 1.0)(late)  # of i_e, which the model delays exactly
        (A, B, C, D), (a, b, c, d) = own.plant(theta), own.controller
        closed = np.block([[A - B @ d @ C, -B @ c], [b @ C, a]]), np.vstack([B, 0.0 * b[:, :4]])
        loop = frequency_response((*closed, np.hstack([C - D @ d @ C, -D @ c]), D), 2j * np.pi * F)
        expected = analog.loop.frequency_response(theta, F)
        assert_allclose(loop * exact[:, None, None], expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_closed_again_a_digital_loop_is_the_loop(digital, validated):
    own = ambid.uncertain(digital)
    whole = int(own.delay_samples)
    part = own.delay_samples - whole
    z = np.exp(2j * np.pi * F * own.dt)
    for theta in values_of(digital):
        A, B, C, D = own.plant(theta)
        first = scipy.signal.cont2discrete((A, B, C, D), part * own.dt)
        rest = scipy.signal.cont2discrete((A, B, C, D), (1.0 - part) * own.dt)
        old = frequency_response((rest[0] @ first[0], rest[0] @ first[1], C, 0 * D), z)
        new = frequency_response((rest[0] @ first[0], rest[1], C, 0 * D), z)
        G = old / (z ** (whole + 1))[:, None, None] + new / (z**whole)[:, None, None]
        K = frequency_response(own.controller, z)
        loop = G @ np.linalg.inv(np.eye(4) + K @ G)
        expected = digital.loop.frequency_response(theta, F)
        validated(
            "Exported uncertain model of a digital loop, closed again: error of the response relative to its peak",
            "SciPy {scipy}: zero-order hold with fractional delay, feedback by NumPy {numpy}",
            (loop - expected) / np.abs(expected).max(),
            1e-10,
        )


def test_delta_holds_every_number_at_its_place(analog):
    own = ambid.uncertain(analog)
    delta = np.diag(own.delta())
    k_i = [k for k, index in enumerate(own.parameter) if own.parameters[index] == "K_i.A_zeta"]
    assert [delta[k] for k in k_i] == [analog.theta[0]] * len(k_i)
    tau_e = [k for k, index in enumerate(own.parameter) if own.parameters[index] == "tau_e"]
    assert_allclose(delta[tau_e], own.scale[tau_e] / analog.theta[analog.names.index("tau_e")])
    assert_allclose(own.ci95[0], analog.theta[0] * (1.0 + 0.02 * 1.959964 * np.array([-1.0, 1.0])))
    assert "K_i.A_zeta" in str(own)


def test_samples_spread_as_the_covariance_says(analog):
    own = ambid.uncertain(analog)
    drawn = own.samples(4000, seed=1)
    size = np.sqrt(np.diag(own.covariance))
    assert_allclose(np.cov((drawn / size).T), own.covariance / np.outer(size, size), atol=0.08)
    assert_allclose(drawn, own.samples(4000, seed=1))
    plants = own.to_control(2, seed=1)
    assert_allclose(plants[1].A, own.plant(own.samples(2, seed=1)[1])[0])
    assert plants[0].input_labels[0] == "i_ref_A_zeta"
    assert plants[0].output_labels[-1] == "i_c_B_eta"


def test_a_parameter_that_was_not_free_is_a_number(analog):
    covariance = analog.covariance.copy()
    covariance[2, :] = covariance[:, 2] = np.nan
    own = ambid.uncertain(analog.with_covariance(covariance))
    assert np.isnan(own.ci95[2]).all()
    assert np.all(own.samples(5)[:, 2] == analog.theta[2])


def test_errors_of_the_controllers_gains_are_in_k(demo_rig):
    errors = {"proportional": 0.1, "integral": 0.2, "derivative": -0.05}
    models = Model(demo_rig), Model(demo_rig).add("controller_gain_error", errors)
    K = [frequency_response(ambid.uncertain(known(model)).controller, 2j * np.pi * F)[:, 0, 0] for model in models]
    s, pid = 2j * np.pi * F, demo_rig.controller
    more = 0.1 * pid.proportional + 0.2 * pid.integral / s
    more -= 0.05 * pid.derivative * s / (pid.derivative_time_constant * s + 1.0)
    assert_allclose(K[1] - K[0], more, rtol=1e-9)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda model: model.with_theta(model.theta), id="no covariance"),
        pytest.param(lambda model: known(model.add("flux_saturation")), id="nonlinear"),
        pytest.param(lambda model: known(model, 0.6), id="too wide"),
    ],
)
def test_what_is_not_allowed_is_refused(analog, change, golden):
    with golden.raises(ModelError):
        ambid.uncertain(change(analog))


@pytest.mark.parametrize("name", ["a.txt", "6A bench.mat"])
def test_names_that_no_script_can_have_are_refused(analog, tmp_path, name, golden):
    with golden.raises(ModelError):
        ambid.uncertain(analog).to_mat(tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", ["analog", "digital", "one axis"])
def test_octave_reads_the_files_and_closes_the_nominal_loop(kind, request, tmp_path, validated):
    octave = shutil.which("octave-cli") or shutil.which("octave")
    if octave is None:
        pytest.skip("there is no octave on this machine: apt-get install octave")
    model = known(Model(ambid.Rig.load(LEVITATOR))) if kind == "one axis" else request.getfixturevalue(kind)
    own = ambid.uncertain(model)
    assert [path.name for path in own.to_mat(tmp_path / "bench.mat")] == ["bench.mat", "bench_uss.m"]
    shown = "run('bench_uss.m'); save('-v7', 'out.mat', 'nominal_plant', 'nominal_poles', 'n_w', 'm');"
    subprocess.run([octave, "--no-gui", "--eval", shown], cwd=tmp_path, check=True, capture_output=True, timeout=120)
    out = scipy.io.loadmat(tmp_path / "out.mat", squeeze_me=True, simplify_cells=True)
    for name, matrix in zip("ABCD", own.plant(), strict=True):
        found = np.reshape(out["nominal_plant"][name], matrix.shape)
        assert_allclose(found, matrix, rtol=1e-12, atol=1e-12 * (np.abs(matrix).max() or 1.0))
    assert out["n_w"] == len(own.parameter)
    assert [name.replace("_", ".", 2) for name in np.atleast_1d(out["m"]["parameters"])[:1]] == ["K.i.A_zeta"]
    poles = model.poles() if own.dt == 0.0 else np.exp(model.poles() * own.dt)
    found = np.atleast_1d(out["nominal_poles"])
    found = found[np.abs(found) > 1e-9]
    validated(
        "Poles of the exported uncertain model, closed at its nominal values: relative error",
        "GNU Octave",
        [np.abs(found - pole).min() / np.abs(pole) for pole in poles[np.abs(poles) > 1e-9]],
        1e-6,
    )
