"""Tables of frequency responses as analysers write them, against the closed form of a resonance."""

import re

import numpy as np
import pytest
import scipy.io

from ambid import ChannelMap, FrequencyResponse, Rig, load_measurement
from ambid.errors import InputError, RecordError
from found import codes, the
from places import LEVITATOR

RIG = Rig.load(LEVITATOR)
AXIS = RIG.axes[0]
PAIR = {"output": f"y.{AXIS}", "input": f"i_e.{AXIS}"}
F = np.geomspace(5.0, 900.0, 40)
S = 2j * np.pi * F
H = 30.0 / (S**2 + 120.0 * S + 4e5)
"""A response of y to i_e [m/A]."""
DECIBELS, DEGREES = 20.0 * np.log10(np.abs(H)), np.degrees(np.angle(H))
STD = 0.02 * np.abs(H)


def write(path, header, *columns, separator=",", below=()):
    rows = [
        separator.join(own if isinstance(own, str) else f"{own:.15g}" for own in row)
        for row in zip(*columns, strict=True)
    ]
    path.write_text("\n".join([header, *below, *rows]) + "\n", encoding="utf-8")
    return path


def table(path, names, *columns, **options):
    """A table of the one pair."""
    pair = [[own] * len(columns[0]) for own in PAIR.values()]
    return write(path, f"output,input,{names}", *pair, *columns, **options)


def h_of(response):
    return response.response[:, 0, 0]


FORMS = {
    "re,im": (H.real, H.imag),
    "magnitude,phase_deg": (np.abs(H), DEGREES),
    "magnitude,phase_rad": (np.abs(H), np.angle(H)),
    "magnitude_db,phase_deg": (DECIBELS, DEGREES),
    "magnitude_db,phase_rad": (DECIBELS, np.unwrap(np.angle(H)) + 4.0 * np.pi),
    "Magnitude (dB),Phase [deg]": (DECIBELS, DEGREES),
    "Mag [um/A],Phase (°)": (1e6 * np.abs(H), DEGREES),
    "Gain [dB re 1 mm/A],Phase (rad)": (DECIBELS + 60.0, np.angle(H)),
    "dB,deg": (DECIBELS, DEGREES),
    "Trace 1: Gain: Magnitude (dB),Trace 1: Gain: Phase (°)": (DECIBELS, DEGREES),
}


@pytest.mark.parametrize("names", FORMS)
def test_values_are_read_in_every_form(tmp_path, names):
    path = table(tmp_path / "frf.csv", f"frequency_hz,{names},std", F, *FORMS[names], STD)
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert found.findings == ()


MOTIONS = {
    "mm/s/A": (1e3 * S, "velocity"),
    "dB re 1 in/s/A": (S / 0.0254, "velocity"),
    "m/s^2/A": (S**2, "acceleration"),
    "g/mA": (1e-3 * S**2 / 9.80665, "acceleration"),
}


@pytest.mark.parametrize("unit", MOTIONS)
def test_velocities_and_accelerations_are_integrated(tmp_path, unit):
    factor, motion = MOTIONS[unit]
    size, phase = np.abs(factor * H), np.angle(factor * H)
    size = 20.0 * np.log10(size) if unit.startswith("dB") else size
    path = table(tmp_path / "frf.csv", f"frequency_hz,Mag [{unit}],phase_rad,std", F, size, phase, STD)
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    values = dict(the(found, "units_converted").values)
    assert values == {"channels": [PAIR["output"]], "found": f"{motion} in {unit.split()[-1]}", "unit": "m"}


def test_an_acceleration_at_a_sensor_is_one(tmp_path):
    names = "frequency_hz,output,input,magnitude (mg/A),phase_rad,std"
    response = S**2 * H
    pair = [[own] * len(F) for own in ("a.foot", PAIR["input"])]
    size = np.abs(response) / 9.80665e-3
    path = write(tmp_path / "frf.csv", names, F, *pair, size, np.angle(response), np.abs(response))
    np.testing.assert_allclose(h_of(load_measurement(path)), response, rtol=1e-12)


@pytest.mark.parametrize("unit", ["um/A pk", "um/A RMS", "um peak/A peak", "um rms / A rms", "um/A pk-pk"])
def test_peaks_by_peaks_and_rms_by_rms_are_a_ratio(tmp_path, unit):
    path = table(tmp_path / "frf.csv", f"frequency_hz,Mag ({unit}),phase_deg,std", F, 1e6 * np.abs(H), DEGREES, STD)
    np.testing.assert_allclose(h_of(load_measurement(path, RIG)), H, rtol=1e-12)


SPELLED = [
    ("Frequency (Hz)", "Mag y", "Phase y"),
    ("f / Hz", "|H| (dB)", "Phase (deg)"),
    ("f [Hz]", "|H| [dB]", "arg(H) [rad]"),
    ("Freq{Hz}", "CH2 Gain{dB}", "CH2 Phase{deg}"),
    ("Frequency, Hz", "Magnitude y, dB", "Phase y, deg"),
    ("Frequenz in Hz", "Betrag in dB", "Phase in grad"),
    ("Frequency(Hz)", "CH2 Amplitude(dB)", "CH2 Phase(Deg)"),
    ("Freq [Hz]", "FRF Magnitude / dB", "FRF Phase / °"),
    ("frequency_hz", "|y/i_e| in um/A", "∠ y/i_e (rad)"),
    ("Frequency [Hz]", "Mag(y/i_e) [um/A]", "Phase(y/i_e) [deg]"),
    ("Frequency [Hz]", "Real part y", "Imag part y"),
    ("Frequency <Hz>", "Re(H)", "Im(H)"),
    ("Hz", "H mag (abs)", "H phase (rad)"),
    ("Frequency Hz", "Mag y dB", "Phase y deg"),
]


@pytest.mark.parametrize("names", SPELLED, ids=" ".join)
def test_names_are_read_as_they_are_spelled(tmp_path, names):
    text = ",".join(f'"{name}"' for name in names)
    size = DECIBELS if "db" in text.lower() else 1e6 * np.abs(H) if "um/A" in text else np.abs(H)
    values = (
        (H.real, H.imag) if "Re" in names[1] else (size, np.angle(H) if re.search(r"\brad\b", names[2]) else DEGREES)
    )
    found = load_measurement(write(tmp_path / "frf.csv", text, F, *values), RIG)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert found.pairs == [f"y.{AXIS} / i_e.{AXIS}"]


def test_a_label_that_is_a_signal_names_the_output(tmp_path):
    found = load_measurement(
        write(tmp_path / "frf.csv", "Frequency [Hz],Mag i_c,Phase i_c", F, np.abs(H), DEGREES), RIG
    )
    assert found.outputs == (f"i_c.{AXIS}",)


ABSCISSAS = {
    "frequency_hz": F,
    "frequency_rad_s": 2.0 * np.pi * F,
    "frequency_rpm": 60.0 * F,
    "Frequency (kHz)": 1e-3 * F,
    "Hz": F,
    "omega [rad/s]": 2.0 * np.pi * F,
    "w": 2.0 * np.pi * F,
    "angular frequency": 2.0 * np.pi * F,
    "Speed (rpm)": 60.0 * F,
    "speed_rpm": 60.0 * F,
    "n [1/min]": 60.0 * F,
    "Drehzahl in U/min": 60.0 * F,
}


@pytest.mark.parametrize("name", ABSCISSAS)
def test_frequencies_are_read_in_every_unit(tmp_path, name):
    path = table(tmp_path / "frf.csv", f"{name},magnitude,phase_deg,std", ABSCISSAS[name], np.abs(H), DEGREES, STD)
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)


def test_an_angular_frequency_of_matlab_is_in_its_own_unit_of_time(tmp_path):
    names = "Frequency(rad/TimeUnit),magnitude,phase_deg,std"
    found = load_measurement(table(tmp_path / "frf.csv", names, 2.0 * np.pi * F, np.abs(H), DEGREES, STD), RIG)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    assert the(found, "units_assumed").values["units"] == {"Frequency(rad/TimeUnit)": "rad/s"}


def test_a_speed_beside_a_frequency_is_not_used(tmp_path):
    names = "Speed (rpm),Frequency (Hz),magnitude,phase_deg,std"
    path = table(tmp_path / "frf.csv", names, np.full(len(F), 3000.0), F, np.abs(H), DEGREES, STD)
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    assert the(found, "columns_not_used").values["names"] == ["Speed (rpm)"]


def test_an_abscissa_that_nothing_shows_is_asked_for(tmp_path, golden):
    path = table(tmp_path / "frf.csv", "Speed,magnitude,phase_deg,std", 60.0 * F, np.abs(H), DEGREES, STD)
    with golden.raises(RecordError):
        load_measurement(path, RIG)
    found = load_measurement(path, RIG, mapping={"frequency_rpm": "Speed"})
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)


def test_columns_that_are_channels_are_none_of_responses(tmp_path):
    motion = 1e-6 * np.random.default_rng(1).standard_normal(600)
    path = write(tmp_path / "run.csv", "Time,Amplitude,Phase", np.arange(600) / RIG.sample_rate, motion, 1e5 * motion)
    mapping = {"t": "Time", f"y.{AXIS}": "Amplitude", f"i_e.{AXIS}": "Phase"}
    np.testing.assert_allclose(load_measurement(path, RIG, mapping=mapping).y[:, 0], motion, rtol=1e-12)


@pytest.mark.parametrize("name", ["frequency_hz", "frequency_rad_s", "frequency_rpm"])
def test_the_same_of_matlab(tmp_path, name):
    names = {
        key: np.array([[own]], dtype=object) for key, own in (("outputs", PAIR["output"]), ("inputs", PAIR["input"]))
    }
    tables = {"magnitude_db": DECIBELS, "phase_deg": DEGREES, "std": STD}
    content = {name: ABSCISSAS[name], **{key: own[:, None] for key, own in tables.items()}, **names}
    scipy.io.savemat(tmp_path / "frf.mat", content)
    found = load_measurement(tmp_path / "frf.mat", RIG)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)


def test_a_table_without_units_or_pair_says_what_was_assumed(tmp_path):
    path = write(tmp_path / "bode.csv", "Frequency\tPhase\tGain", F, DEGREES, DECIBELS, separator="\t")
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert codes(found) == ["units_assumed", "pair_assumed", "std_from_scatter"]
    assert the(found, "units_assumed").values["units"] == {"Frequency": "Hz", "Gain": "dB", "Phase": "deg"}
    assert dict(the(found, "pair_assumed").values) == PAIR
    assert the(found, "pair_assumed").severity == "warning"


def test_a_map_names_columns_and_pair(tmp_path):
    path = write(tmp_path / "bode.csv", "F / kHz;A;B", 1e-3 * F, 1e6 * np.abs(H), DEGREES, separator=";")
    options = ["frequency_hz=F / kHz:1e3", "magnitude=2:1e-6", "phase_deg=B"]
    mapping = ChannelMap.parse([*options, *(f"{name}={channel}" for name, channel in PAIR.items())])
    found = load_measurement(path, RIG, mapping=mapping)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert codes(found) == ["std_from_scatter"]


def test_a_line_of_units_below_the_header_is_used(tmp_path):
    path = write(tmp_path / "bode.csv", "Frequency,Gain,Phase", 1e-3 * F, DECIBELS, DEGREES, below=["kHz,dB,deg"])
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-13)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert codes(found) == ["pair_assumed", "std_from_scatter"]


@pytest.mark.parametrize(
    ("encoding", "findings"), [("cp1252", ["read_as_windows_1252"]), ("utf-16", []), ("utf-8-sig", [])]
)
def test_a_table_in_another_encoding(tmp_path, encoding, findings):
    path = table(tmp_path / "frf.csv", "Freq (Hz),Mag (dB),Phase (°),std", F, DECIBELS, DEGREES, STD)
    path.write_bytes(path.read_text(encoding="utf-8").encode(encoding))
    found = load_measurement(path, RIG)
    np.testing.assert_allclose(h_of(found), H, rtol=1e-12)
    assert codes(found) == findings


def test_what_analysers_write_above_the_header_is_passed_over(tmp_path):
    path = table(tmp_path / "frf.csv", "frequency_hz,magnitude_db,phase_deg,std", F, DECIBELS, DEGREES, STD)
    path.write_text("sep=,\n! sweep, 10 mA\n% bench 3\n" + path.read_text())
    assert codes(load_measurement(path, RIG)) == ["comment_lines"]


REFUSED = {
    "no phase": ("frequency_hz,magnitude", (F, np.abs(H))),
    "no frequency": ("number,magnitude,phase_deg", (F, np.abs(H), DEGREES)),
    "negative magnitude": ("frequency_hz,magnitude,phase_deg", (F, DECIBELS, DEGREES)),
    "gain of no unit": ("frequency_hz,gain,phase_deg", (F, 1e6 * np.abs(H), DEGREES)),
    "phase of no unit": ("frequency_hz,magnitude,phase", (F, np.abs(H), DEGREES / 10.0)),
    "two magnitudes": ("frequency_hz,gain (db),mag (db),phase_deg", (F, DECIBELS, DECIBELS, DEGREES)),
    "a voltage": ("frequency_hz,magnitude (mV/A),phase_deg", (F, np.abs(H), DEGREES)),
    "peaks by rms": ("frequency_hz,magnitude (um pk/A rms),phase_deg", (F, np.abs(H), DEGREES)),
    "a word": ("frequency_hz,magnitude,phase_deg", (F, [*np.abs(H[:-1]), "over"], DEGREES)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_wrong_table_is_refused_in_its_own_words(tmp_path, name, golden):
    names, columns = REFUSED[name]
    path = table(tmp_path / "frf.csv", names, *columns)
    with golden.raises(RecordError):
        FrequencyResponse.load(path, RIG)


def test_a_pair_of_several_axes_is_not_assumed(tmp_path, golden):
    path = write(tmp_path / "bode.csv", "frequency_hz,magnitude_db,phase_deg", F, DECIBELS, DEGREES)
    with golden.raises(RecordError):
        FrequencyResponse.load(path)


@pytest.mark.parametrize("option", ["frequency_hz=nowhere", "phase_deg=9"])
def test_a_map_of_no_column_is_refused(tmp_path, option, golden):
    path = write(tmp_path / "bode.csv", "frequency_hz,magnitude_db,phase_deg", F, DECIBELS, DEGREES)
    with golden.raises(InputError):
        FrequencyResponse.load(path, RIG, mapping=ChannelMap.parse([option]))


def test_signals_over_time_have_no_columns_of_responses(tmp_path, golden):
    path = write(tmp_path / "run.csv", f"t,y.{AXIS}", F, F)
    with golden.raises(RecordError):
        load_measurement(path, RIG, mapping={"magnitude": f"y.{AXIS}"})


def with_coherence(path, coherence, averages=None, f=F, h=H):
    names = "frequency_hz,re,im,coherence" + ("" if averages is None else ",averages")
    columns = (f, h.real, h.imag, coherence, *([] if averages is None else [np.full(len(f), averages)]))
    return load_measurement(table(path / "frf.csv", names, *columns), RIG)


def test_coherence_gives_the_std(tmp_path):
    """Bendat and Piersol: the variance is |H|^2 (1 - g) / (g n); it is raised by n / (n - 2), being an estimate."""
    coherence = np.linspace(0.5, 0.99999, len(F))
    found = with_coherence(tmp_path, coherence, averages=12)
    wanted = np.abs(H) * np.sqrt((1.0 - coherence) / coherence / 10.0)
    np.testing.assert_allclose(found.std[:, 0, 0], wanted, rtol=1e-9)
    assert codes(found) == ["std_from_coherence"]


def test_coherence_without_averages_gives_relative_weights(tmp_path):
    coherence = np.linspace(0.5, 0.99, len(F))
    found = with_coherence(tmp_path, coherence)
    ratio = found.std[:, 0, 0] / (np.abs(H) * np.sqrt((1.0 - coherence) / coherence))
    assert np.ptp(ratio) / ratio[0] == pytest.approx(0.0, abs=1e-9)
    assert codes(found) == ["averages_estimated"]


@pytest.mark.parametrize("one", [1.0, 0.9999999])
def test_coherence_of_one_everywhere_is_passed_over(tmp_path, one):
    found = with_coherence(tmp_path, np.full(len(F), one), averages=8)
    without = load_measurement(table(tmp_path / "none.csv", "frequency_hz,re,im", F, H.real, H.imag), RIG)
    np.testing.assert_array_equal(found.std, without.std)
    assert codes(found) == ["coherence_one", "std_from_scatter"]
    assert the(found, "coherence_one").values["pairs"] == [" / ".join(PAIR.values())]


def test_coherence_that_is_one_at_some_lines_counts(tmp_path):
    coherence = np.where(np.arange(len(F)) % 2, 1.0, 0.9)
    found = with_coherence(tmp_path, coherence, averages=12)
    assert codes(found) == ["std_from_coherence"]
    largest = 1.0 - 0.5e-4  # four digits are believed
    np.testing.assert_allclose(found.std[1, 0, 0], np.abs(H[1]) * np.sqrt((1.0 - largest) / largest / 10.0))


def test_a_line_at_zero_is_passed_over(tmp_path):
    f, h = np.insert(F, 0, 0.0), np.insert(H, 0, H[0])
    found = with_coherence(tmp_path, np.full(len(f), 0.9), averages=8, f=f, h=h)
    np.testing.assert_allclose(found.frequency_hz, F)
    assert codes(found) == ["zero_frequency_not_used", "std_from_coherence"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"h": 0.0}, "zero_values_not_used"),
        ({"h": np.nan}, "frequencies_missing"),
        ({"coherence": 0.0}, "coherence_missing"),
        ({"coherence": np.nan}, "coherence_missing"),
    ],
    ids=["zero", "nan", "no coherence", "coherence nan"],
)
def test_single_lines_that_say_nothing_are_passed_over(tmp_path, change, code):
    own = {"h": H.copy(), "coherence": np.full(len(F), 0.9)}
    for name, value in change.items():
        own[name][7] = value
    found = with_coherence(tmp_path, own["coherence"], averages=8, h=own["h"])
    assert np.flatnonzero(~found.measured[:, 0, 0]).tolist() == [7]
    assert code in codes(found)
    assert np.ravel(the(found, code).values["frequencies_hz"]) == pytest.approx(F[7])
    assert np.isfinite(found.std[found.measured]).all()


def test_several_pairs_beside_each_other_are_read_by_their_names(tmp_path):
    i_c = 0.5 / (1.0 + 2e-4 * S)
    quantities = ("magnitude_db", "phase_deg")
    names = [f"{signal}.{AXIS} / i_e.{AXIS} {own}" for signal in ("y", "i_c") for own in quantities]
    columns = [DECIBELS, DEGREES, 20.0 * np.log10(np.abs(i_c)), np.degrees(np.angle(i_c))]
    path = write(tmp_path / "wide.csv", ",".join(["frequency_hz", *names]), F, *columns)
    found = load_measurement(path, RIG)
    both = {f"y.{AXIS}": H, f"i_c.{AXIS}": i_c}
    assert set(found.outputs) == set(both)
    for k, name in enumerate(found.outputs):
        assert found.response[:, k, 0] == pytest.approx(both[name], rel=1e-9)
    path.write_text(path.read_text().replace(f"i_c.{AXIS} / i_e.{AXIS} magnitude_db", f"i_c.{AXIS} / i_e.{AXIS} re"))
    with pytest.raises(RecordError):
        load_measurement(path, RIG)
