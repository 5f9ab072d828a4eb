"""Frequency responses: what every format holds, what is refused in which words, where the std is from, and the local
estimate from a record."""

import hashlib
import signal
from dataclasses import replace

import numpy as np
import pytest
import scipy.io

from ambid import ChannelMap, FrequencyResponse, Model, Record, load_measurement, prbs
from ambid.errors import InputError, RecordError
from ambid.record.local_bands import Bands, fitted_bands
from ambid.record.local_response import local_response, noise_of
from found import codes
from hidden.bench import simulate
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS

RIG = ONE_AXIS.rig
F = np.linspace(5.0, 1500.0, 60)
OUTPUTS, INPUTS = ("y.A_zeta", "i_c.A_zeta"), ("i_e.A_zeta",)


def exact(rig=RIG, f=F):
    model = Model(rig)
    return model.loop.transfer(model.theta, np.exp(2j * np.pi * f / rig.sample_rate))


def noise(std, seed):
    random = np.random.default_rng(seed)
    parts = random.standard_normal((2, *std.shape))
    return std * (parts[0] + 1j * parts[1]) / np.sqrt(2.0)


@pytest.fixture
def measured():
    h = exact()
    std = 0.01 * np.abs(h)
    return FrequencyResponse("frf", F, h + noise(std, 0), std, OUTPUTS, INPUTS)


def rows(response, **changed):
    """Lines of a table, header first."""
    lines = ["frequency_hz,output,input,re,im,std"]
    for k, f in enumerate(response.frequency_hz):
        for o, output in enumerate(response.outputs):
            h = response.response[k, o, 0]
            lines.append(f"{f:.17g},{output},{response.inputs[0]},{h.real:.17g},{h.imag:.17g},{response.std[k, o, 0]}")
    return lines


@pytest.mark.parametrize("suffix", [".csv", ".mat"])
def test_both_formats_hold_the_same(measured, tmp_path, suffix):
    path = tmp_path / f"frf{suffix}"
    measured.save(path)
    again = load_measurement(path, RIG)
    assert isinstance(again, FrequencyResponse)
    np.testing.assert_allclose(again.frequency_hz, F, rtol=1e-15)
    np.testing.assert_allclose(again.response, measured.response, rtol=1e-14)
    np.testing.assert_allclose(again.std, measured.std, rtol=1e-8)
    assert (again.outputs, again.inputs, again.findings, again.name) == (OUTPUTS, INPUTS, (), "frf")


def test_a_pair_that_was_not_measured_stays_so(measured, tmp_path):
    h = measured.response.copy()
    h[7:20, 1, 0] = np.nan
    some = FrequencyResponse("frf", F, h, np.where(np.isnan(h), np.nan, measured.std), OUTPUTS, INPUTS)
    for suffix in (".csv", ".mat"):
        some.save(tmp_path / f"frf{suffix}")
        again = FrequencyResponse.load(tmp_path / f"frf{suffix}", RIG)
        np.testing.assert_array_equal(again.measured, some.measured)


@pytest.mark.parametrize("suffix", [".csv", ".mat"])
def test_the_covariance_is_kept(tmp_path, suffix):
    made = ONE_AXIS_RECORD().frequency_response()
    made.save(tmp_path / f"frf{suffix}")
    again = FrequencyResponse.load(tmp_path / f"frf{suffix}", RIG)
    np.testing.assert_allclose(again.covariance, made.covariance, rtol=1e-11, atol=0.0)
    assert again.spread == pytest.approx(made.spread, rel=1e-8)
    assert made.spread > 1.1
    np.testing.assert_allclose(again.std, made.std)
    assert again.findings == ()


def test_a_covariance_of_a_pair_that_is_not_there_is_told(measured, tmp_path):
    path = tmp_path / "frf.csv"
    header, *lines = rows(measured)
    path.write_text("\n".join([f"{header},cov_re y.B / i_e.B", *(f"{line},0" for line in lines)]) + "\n")
    found = FrequencyResponse.load(path, RIG)
    assert codes(found) == ["columns_not_used"]
    assert found.findings[0].values["names"] == ["cov_re y.B / i_e.B"]
    assert found.covariance is None


def test_a_spread_below_one_is_refused(measured, golden):
    covariance = np.einsum("kp,pq->kpq", measured.std.reshape(60, -1) ** 2, np.eye(2))
    with golden.raises(RecordError):
        FrequencyResponse.from_arrays(
            F, measured.response, outputs=OUTPUTS, inputs=INPUTS, covariance=covariance, spread=0.5
        )


def test_errors_that_have_nothing_to_do_with_each_other_are_no_fault(measured):
    """A correlation of nothing is rounding, which need not be the same in both halves of the matrix."""
    covariance = np.einsum("kp,pq->kpq", measured.std.reshape(60, -1) ** 2, np.eye(2)) + 0j
    size = np.sqrt(covariance[:, 0, 0] * covariance[:, 1, 1])
    covariance[:, 0, 1], covariance[:, 1, 0] = 1e-17 * size, -2e-17 * size
    found = FrequencyResponse.from_arrays(F, measured.response, outputs=OUTPUTS, inputs=INPUTS, covariance=covariance)
    np.testing.assert_allclose(found.std, measured.std)
    assert found.spread == 1.0


def test_a_covariance_of_some_pairs_alone_is_refused(measured, tmp_path, golden):
    path = tmp_path / "frf.csv"
    header, *lines = rows(measured)
    own = "y.A_zeta / i_e.A_zeta"
    path.write_text("\n".join([f"{header},cov_re {own},cov_im {own}", *(f"{line},1e-16,0" for line in lines)]) + "\n")
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)


def ONE_AXIS_RECORD(seed=1, periods=4):
    i_e = prbs(9, amplitude=1.0, hold=4, axes=1, periods=periods)
    own = Model(RIG).virtual_experiment(i_e, seed=seed)
    return Record("run", own.sample_rate, own.axes, own.i_e, own.y, own.i_c, period=len(i_e) // periods)


BROKEN_LINES = {
    "no column": (0, "frequency_hz,output,input,re,std"),
    "a word": (3, "20,y.A_zeta,i_e.A_zeta,abc,0,1e-9"),
    "a cut row": (3, "20,y.A_zeta,i_e.A_zeta,1e-6"),
    "no frequency": (3, "nan,y.A_zeta,i_e.A_zeta,1e-6,0,1e-9"),
    "below zero": (1, "-5,y.A_zeta,i_e.A_zeta,1e-6,0,1e-9"),
    "too high": (1, "90000,y.A_zeta,i_e.A_zeta,1e-6,0,1e-9"),
    "twice": (2, "5,y.A_zeta,i_e.A_zeta,1e-6,0,1e-9"),
    "infinite": (1, "5,y.A_zeta,i_e.A_zeta,inf,0,1e-9"),
    "no std": (1, "5,y.A_zeta,i_e.A_zeta,1e-6,0,"),
    "std below zero": (1, "5,y.A_zeta,i_e.A_zeta,1e-6,0,-1"),
    "another axis": (1, "5,y.C_zeta,i_e.A_zeta,1e-6,0,1e-9"),
    "another name": (1, "5,ch1,i_e.A_zeta,1e-6,0,1e-9"),
    "another unit": (1, "5,y.A_zeta,i_e.A_zeta,40,0,1e-9"),
}


@pytest.mark.parametrize("name", BROKEN_LINES)
def test_a_broken_table_is_refused_in_its_own_words(measured, tmp_path, name, golden):
    lines, (line, text) = rows(measured), BROKEN_LINES[name]
    lines[line] = text
    path = tmp_path / "frf.csv"
    path.write_text("\n".join(lines) + "\n")
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("outputs", None),
        ("response", np.ones((3, 2, 1)) + 0j),
        ("std", np.ones((60, 1, 1))),
        ("inputs", np.array([1.0])),
        ("frequency_hz", F[::-1].copy()),
        ("frequency_hz", np.array(["a"] * 60, dtype=object)),
        ("coherence", 2.0 * np.ones((60, 2, 1))),
        ("covariance", np.zeros((60, 2, 2)) + 0j),
        ("averages", 0.0),
        ("spread", 1.2),
    ],
    ids=["outputs", "response", "std", "inputs", "falling", "letters", "coherence", "covariance", "averages", "spread"],
)
def test_a_broken_mat_is_refused_in_its_own_words(measured, tmp_path, key, value, golden):
    names = {key: np.array(own, dtype=object) for key, own in (("outputs", OUTPUTS), ("inputs", INPUTS))}
    content = {"frequency_hz": F, "response": measured.response, **names}
    if value is None:
        del content[key]
    else:
        content[key] = value
    path = tmp_path / "frf.mat"
    scipy.io.savemat(path, content)
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)


def test_the_std_of_coherence_and_averages(tmp_path):
    """Bendat and Piersol: |H|^2 (1 - g) / (g n), raised by n / (n - 2); without n the scatter gives it."""
    h, coherence = exact(), 0.8 * np.ones((60, 2, 1))
    std = np.abs(h) * np.sqrt(0.2 / 0.8 / 14)
    shown = FrequencyResponse.from_arrays(F, h, outputs=OUTPUTS, inputs=INPUTS, coherence=coherence, averages=16)
    np.testing.assert_allclose(shown.std, std)
    found = FrequencyResponse.from_arrays(F, h + noise(std, 1), outputs=OUTPUTS, inputs=INPUTS, coherence=coherence)
    assert np.median(found.std / std) == pytest.approx(1.0, abs=0.3)
    assert (codes(shown), codes(found)) == (["std_from_coherence"], ["averages_estimated"])


@pytest.mark.parametrize("averages", [8, 18, 60])
def test_what_few_averages_leave_is_one(averages):
    """The coherence is an estimate too: segments of an input and a noisy output, as an analyser averages them."""
    random = np.random.default_rng(averages)
    f = np.linspace(20.0, 900.0, 3000)
    h = exact(f=f)[:, :1]
    x, v = (random.normal(size=(len(f), averages)) + 1j * random.normal(size=(len(f), averages)) for _ in range(2))
    y = h[:, 0] * x + 0.3 * np.abs(h[:, 0]) * v
    cross, own = np.sum(y * x.conj(), axis=1), np.sum(np.abs(x) ** 2, axis=1)
    coherence = np.abs(cross) ** 2 / own / np.sum(np.abs(y) ** 2, axis=1)
    given = {"outputs": OUTPUTS[:1], "inputs": INPUTS, "coherence": coherence[:, None, None], "averages": averages}
    found = FrequencyResponse.from_arrays(f, (cross / own)[:, None, None], **given)
    left = (found.response - h) / found.std
    assert np.mean(np.abs(left) ** 2) == pytest.approx(1.0, abs=0.1)


def test_the_std_of_nothing_but_the_response():
    f = np.linspace(200.0, 400.0, 300)
    h = exact(f=f)
    std = 0.02 * np.abs(h)
    ratios = []
    for seed in range(5):
        own = FrequencyResponse.from_arrays(f, h + noise(std, seed), outputs=OUTPUTS, inputs=INPUTS)
        ratios.append(np.mean(std**2 / own.std**2))
        assert codes(own) == ["std_from_scatter"]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)


def test_too_few_frequencies_tell_no_std(golden):
    with golden.raises(RecordError):
        FrequencyResponse.from_arrays(F[:5], exact(f=F[:5]), outputs=OUTPUTS, inputs=INPUTS)


def write_universal(path, h, coherence=None, names=("y.A_zeta", "i_e.A_zeta")):
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(path))
    for kind, data in ((4, h), (6, coherence)):
        if data is not None:
            file.write_sets(
                pyuff.prepare_58(
                    binary=0,
                    func_type=kind,
                    abscissa_spacing=1,
                    abscissa_spec_data_type=18,
                    ordinate_spec_data_type=8,
                    orddenom_spec_data_type=13,
                    rsp_node=12,
                    rsp_dir=1,
                    ref_node=7,
                    ref_dir=-3,
                    rsp_ent_name=names[0],
                    ref_ent_name=names[1],
                    data=data,
                    x=F,
                    id1="",
                    id2="",
                    id3="",
                    id4="",
                    id5="",
                    ord_data_type=5 if kind == 4 else 2,
                ),
                "add",
            )
    return path


def test_universal_files(tmp_path):
    h = exact()[:, 0, 0]
    path = write_universal(tmp_path / "frf.uff", h)
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(found.response[:, 0, 0], h, rtol=1e-4)
    assert (found.outputs, found.inputs) == (("y.A_zeta",), ("i_e.A_zeta",))
    assert "std_from_scatter" in codes(found)


def test_universal_files_with_coherence_and_nodes_that_have_no_name(tmp_path, golden):
    h = exact()[:, 0, 0]
    path = write_universal(tmp_path / "frf.unv", 1e6 * h, 0.9 * np.ones(60) + 0j, ("NONE", "NONE"))
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)
    mapping = ChannelMap.parse(["y.A_zeta=12+X:1e-6", "i_e.A_zeta=7-Z"])
    found = FrequencyResponse.load(path, RIG, mapping=mapping)
    np.testing.assert_allclose(found.response[:, 0, 0], h, rtol=1e-4)
    assert "averages_estimated" in codes(found)
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG, mapping={"y.A_zeta": "12+X", "i_e.A_zeta": "9+Z"})


def test_a_damaged_universal_file_is_refused(tmp_path, golden):
    pytest.importorskip("pyuff")
    path = tmp_path / "frf.uff"
    path.write_text("no such thing\n" * 5)
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)


@pytest.mark.parametrize("name", ["frf.xls", "none.csv"])
def test_a_file_that_is_none_is_refused(tmp_path, name, golden):
    if name == "frf.xls":
        (tmp_path / name).write_text("x")
    with golden.raises(InputError):
        FrequencyResponse.load(tmp_path / name, RIG)


@pytest.mark.parametrize("periods", [4, None], ids=["periods", "no periods"])
def test_the_local_response_is_the_loops(periods, validated):
    """In units of its std the error has a mean square of 1, with periods and without."""
    misses = []
    for seed in range(6):
        record = ONE_AXIS_RECORD(seed)
        if periods is None:
            record = Record("run", record.sample_rate, record.axes, record.i_e, record.y, record.i_c)
        found = record.frequency_response()
        error = (found.response - exact(f=found.frequency_hz)).reshape(len(found.frequency_hz), -1)
        white = np.linalg.solve(np.linalg.cholesky(found.covariance), error[..., None])[..., 0]
        misses.append(np.mean(np.abs(white) ** 2))
    validated(
        "Measured frequency responses, with and without periods: deviation of the mean square of error / std from 1",
        "true response of the independent simulator's levitator",
        np.mean(misses) - 1.0,
        0.15,
    )


@pytest.mark.parametrize(("channels", "free"), [(2, 10), (8, 10), (4, 6)])
def test_the_spread_of_noise_that_is_told_by_few_lines(channels, free):
    """Whitened by its estimate, noise has a mean square of 1; along what is whitened too, the variance stated."""
    random, count = np.random.default_rng(0), 40
    power, direction, shown = [], [], 0.0
    for _ in range(60):
        white = random.standard_normal((2, count, free, channels)) / np.sqrt(2.0)
        nothing = np.zeros(0)
        bands = Bands(nothing, nothing, {}, white[0] + 1j * white[1], np.full(count, float(free)))
        covariance, spreads = noise_of([bands])
        inverse = np.linalg.inv(covariance)
        power.append(np.mean(np.einsum("kii->ki", inverse).real))
        direction.append(np.mean(np.einsum("kij,kji->k", inverse, inverse).real) / channels)
        shown = np.mean(spreads)
    assert np.mean(power) == pytest.approx(1.0, abs=0.02)
    assert np.mean(direction) / np.mean(power) ** 2 == pytest.approx(shown, rel=0.04)


def test_the_lowest_frequencies_of_four_axes_follow_rigid_modes_and_integrators():
    """Two modes and two integrators of each plane are below 60 Hz, where a band begins at zero."""
    bench = replace(BENCHES["bench"], periods=3)
    base, misses = Model(bench.rig), []
    model = base.with_values(dict(zip(base.names, (*bench.K_i, *bench.K_s, bench.tau_e), strict=True)))
    for seed in range(8):
        i_e = bench.excitation(bench.amplitude, seed)
        record = simulate(bench.rig, i_e, period=bench.period, seed=seed, **bench.truth, **bench.noise)
        found = record.frequency_response().some(slice(0, 4))
        points = np.exp(2j * np.pi * found.frequency_hz / record.sample_rate)
        error = (found.response - model.loop.transfer(model.theta, points)[:, :, :4]).reshape(4, -1)
        white = np.linalg.solve(np.linalg.cholesky(found.covariance), error[..., None])
        own = np.einsum("kaa->ka", found.std[:, :4] / np.abs(found.response[:, :4]))
        misses.append((np.mean(np.abs(white) ** 2), np.median(own)))
    assert np.mean(misses, axis=0)[0] == pytest.approx(1.0, abs=0.3)
    assert np.mean(misses, axis=0)[1] < 0.002


def test_axes_that_are_excited_together_are_told_apart(bench, i_e):
    long = prbs(11, amplitude=0.15, hold=2, axes=4, periods=3)
    (record,) = bench.records(long, [1], period=4094)
    found = record.frequency_response()
    assert found.inputs == tuple(f"i_e.{axis}" for axis in record.axes)
    model = Model(bench.rig())
    error = found.response - model.loop.transfer(model.theta, np.exp(2j * np.pi * found.frequency_hz / 1e4))
    relative = np.abs(error)[found.frequency_hz > 60.0] ** 2 / found.std[found.frequency_hz > 60.0] ** 2
    assert np.mean(relative) == pytest.approx(1.0, abs=0.15)


def test_too_few_lines_are_refused(bench, run, golden):
    with golden.raises(RecordError):
        Record("short", 1e4, run.axes, run.i_e[:200], run.y[:200], run.i_c[:200], period=50).frequency_response()


def test_only_axes_that_are_excited_are_inputs(bench):
    i_e = prbs(9, amplitude=0.15, hold=2, axes=4, periods=3)
    i_e[:, 1:] = 0.0
    (record,) = bench.records(i_e, [1], period=len(i_e) // 3)
    assert record.frequency_response().inputs == ("i_e.A_zeta",)


@pytest.mark.parametrize("suffix", [".csv", ".mat"])
def test_what_was_read_is_told_by_its_hash(tmp_path, suffix):
    path = tmp_path / f"frf{suffix}"
    response = FrequencyResponse.from_arrays(
        [1.0, 2.0, 3.0],
        np.full((3, 1, 1), 1.0 - 1.0j),
        outputs=["y.A_zeta"],
        inputs=["i_e.A_zeta"],
        std=np.ones((3, 1, 1)),
    )
    response.save(path)
    content = path.read_bytes()
    found = load_measurement(path)
    path.unlink()
    assert (found.provenance.sha256, found.provenance.size) == (hashlib.sha256(content).hexdigest(), len(content))


def test_axes_that_are_driven_alike_share_what_cannot_be_told_apart():
    """One excitation on two axes: the pseudo-inverse gives each half of the response, and no warning is raised."""
    rng = np.random.default_rng(5)
    drive = rng.standard_normal((4000, 1))
    y = 2.0 * drive + 1e-3 * rng.standard_normal((4000, 1))
    alone = local_response("run", drive, y, 1e3, None)
    twice = local_response("run", np.hstack([drive, drive]), y, 1e3, None)
    assert np.abs(alone.response - 2.0).max() < 1e-2
    assert np.abs(twice.response - 1.0).max() < 1e-2


def test_a_band_by_itself_is_as_among_many():
    rng = np.random.default_rng(6)
    u, z = (rng.standard_normal((40, 30, n)) + 1j * rng.standard_normal((40, 30, n)) for n in (2, 3))
    together = fitted_bands(u, z)
    for k in (0, 17, 39):
        alone = fitted_bands(u[k : k + 1], z[k : k + 1])
        for name in ("response", "spread", "left", "free"):
            np.testing.assert_allclose(getattr(alone, name)[0], getattr(together, name)[k], rtol=1e-9, atol=1e-12)


def test_a_signal_gets_through_the_bands_of_a_long_record():
    """Many bands take seconds; none of the steps within does."""
    rng = np.random.default_rng(7)
    u, z = (rng.standard_normal((60_000, 30, n)) + 0j for n in (1, 2))
    was = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.2)
        with pytest.raises(KeyboardInterrupt):
            fitted_bands(u, z)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, was)
