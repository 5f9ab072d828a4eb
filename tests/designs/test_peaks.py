"""What an excitation does, against the loop's own response, and the files that it is played from."""

import numpy as np
import pytest
from scipy.io import loadmat, wavfile

import ambid
from ambid.designs import Limits, forecast, save_excitation
from ambid.designs.peaks import ABOVE_LIMIT, WITHIN_LIMITS
from ambid.errors import InputError, RecordError
from places import BENCH, LEVITATOR

RIG = ambid.Rig.load(LEVITATOR)


def excitation(axes=1, periods=3):
    return ambid.prbs(7, amplitude=0.2, hold=4, axes=axes, periods=periods)


def test_peaks_are_those_of_the_simulated_response():
    i_e = excitation()
    shown = forecast(RIG, i_e, period=127 * 4)
    record = ambid.Model(RIG).simulate(i_e)
    (axis,) = shown.axes
    np.testing.assert_allclose(axis.y, np.abs(record.y).max(), rtol=1e-6)
    np.testing.assert_allclose(axis.i_c_over_bias, np.abs(record.i_c).max() / 4.0, rtol=1e-6)
    np.testing.assert_allclose(axis.y_over_gap, np.abs(record.y).max() / 0.6e-3, rtol=1e-6)
    assert axis.i_e == 0.2
    assert (shown.periods, shown.seconds) == (3, 3 * 508 / 1e4)
    np.testing.assert_allclose(shown.line_spacing_hz, 1e4 / 508)


def test_band_holds_nine_tenths_of_the_power():
    i_e = ambid.multisine(1000, rms=0.1, lines=list(range(10, 110)))
    low, high = forecast(RIG, i_e).band_hz
    assert low == 100.0
    assert high in (990.0, 1000.0)  # the 90th of 100 lines, or by rounding the 91st


@pytest.mark.parametrize(
    ("limits", "channel", "limit", "unit"),
    [
        ({"travel": 1e-3}, "y.A_zeta", 0.6e-6, "m"),
        ({"current": 1e-3}, "i_c.A_zeta", 4e-3, "A"),
        ({"excitation": 0.1}, "i_e.A_zeta", 0.1, "A"),
        ({"slew_rate": 1.0}, "i_c.A_zeta", 1.0, "A/s"),
    ],
)
def test_a_limit_that_is_exceeded_is_a_finding_and_weighs_more_than_one(limits, channel, limit, unit, golden):
    assert forecast(RIG, excitation()).findings == ()
    shown = forecast(RIG, excitation(), limits=Limits(**limits))
    above, within = shown.findings
    assert (above.kind, above.where.channel, above.values["unit"]) == (ABOVE_LIMIT, channel, unit)
    assert above.values["limit"] == pytest.approx(limit)
    assert above.values["peak"] / limit == pytest.approx(shown.load)
    assert shown.load > 1.0 > forecast(RIG, excitation()).load
    assert shown.to_json()["findings"] == [own.as_dict() for own in shown.findings]
    golden.holds("\n".join(shown.notes))


def test_the_peak_that_is_advised_stays_within_the_limits():
    limits = Limits(travel=1e-3)
    *_, advice = forecast(RIG, excitation(), limits=limits).findings
    assert advice.kind is WITHIN_LIMITS
    peak = float(f"{advice.values['peak']:.3g}")  # as it is printed
    scaled = excitation() * peak / np.abs(excitation()).max()
    assert 0.95 < forecast(RIG, scaled, limits=limits).load <= 1.0


def test_load_is_one_where_the_excitation_is_scaled_to_its_limit():
    shown = forecast(RIG, excitation())
    np.testing.assert_allclose(forecast(RIG, excitation() / shown.load).load, 1.0, rtol=1e-6)


@pytest.mark.parametrize("limits", [{"travel": 0.0}, {"current": np.nan}, {"slew_rate": -1.0}])
def test_limits_refuse(limits, golden):
    with golden.raises(InputError):
        Limits(**limits)


def test_forecast_refuses_parts_of_periods(golden):
    with golden.raises(InputError):
        forecast(RIG, excitation(), period=500)


def test_wav_holds_the_excitation_in_parts_of_full_scale(tmp_path):
    rig, path = ambid.Rig.load(BENCH), tmp_path / "i_e.wav"
    i_e = ambid.multisine(1000, rms=0.1, lines=list(range(10, 110)), axes=4)
    save_excitation(path, rig, i_e, full_scale=0.5)
    rate, samples = wavfile.read(path)
    assert rate == rig.sample_rate
    np.testing.assert_allclose(samples * (0.5 / (2**31 - 1)), i_e, atol=1e-9)
    assert b"full scale 2147483647 = 0.5 A; channels i_e.A_zeta, i_e.A_eta, i_e.B_zeta, i_e.B_eta" in path.read_bytes()
    assert int.from_bytes(path.read_bytes()[4:8], "little") == path.stat().st_size - 8


def test_csv_and_mat_hold_the_excitation_as_a_record_would(tmp_path):
    save_excitation(tmp_path / "i_e.csv", RIG, excitation())
    save_excitation(tmp_path / "i_e.mat", RIG, excitation())
    table = np.genfromtxt(tmp_path / "i_e.csv", delimiter=",", names=True, deletechars="")
    assert table.dtype.names == ("t", "i_e.A_zeta")
    np.testing.assert_array_equal(table["i_e.A_zeta"], excitation()[:, 0])
    np.testing.assert_array_equal(loadmat(tmp_path / "i_e.mat")["i_e"], excitation())


def test_playing_refuses(tmp_path, golden):
    with golden.raises(RecordError):
        save_excitation(tmp_path / "i_e.txt", RIG, excitation())
    with golden.raises(InputError):
        save_excitation(tmp_path / "i_e.wav", RIG, excitation(), full_scale=0.1)
    with golden.raises(InputError):
        save_excitation(tmp_path / "i_e.wav", RIG.replace(sample_rate=9999.5), excitation())
    with golden.raises(InputError):
        save_excitation(tmp_path / "i_e.csv", RIG, excitation(axes=2))
    assert list(tmp_path.iterdir()) == []
