"""What has a frequency of its own: found where it is, as often as chance allows, and never in pure noise."""

from dataclasses import replace

import numpy as np
import pytest

from ambid import Model, Noise, compare, diagnose, identify, prbs
from ambid.effects import find
from ambid.noise.lines import RecordLines
from ambid.noise.measured import Measured
from ambid.noise.tones import find_tones
from ambid.noise.wave import OUTSTANDING
from hidden.bench import simulate
from hidden.experiment import experiment_on
from hidden.families import BENCHES
from hidden.one_axis import ONE_AXIS
from hidden.sizes import find as find_size
from hidden.strangers import stranger
from tiers import first_fast

RATE = ONE_AXIS.rig.sample_rate
NAMES = ("K_i.A_zeta", "K_s.A_zeta", "tau_e")
EXACT = Model(ONE_AXIS.rig).with_values(dict(zip(NAMES, (*ONE_AXIS.K_i, *ONE_AXIS.K_s, ONE_AXIS.tau_e), strict=True)))
LINE = RATE / (3 * ONE_AXIS.period)
"""From one line to the next in the three settled periods [Hz]."""


def hummed(*hums, seed=1):
    """A record whose command current has hums of these frequencies [Hz] and amplitudes [A]."""
    i_e = ONE_AXIS.excitation(ONE_AXIS.amplitude)
    hum = sum((a * np.cos(2.0 * np.pi * f / RATE * np.arange(len(i_e)) + 0.7) for f, a in hums), np.zeros(len(i_e)))
    made = simulate(ONE_AXIS.rig, i_e + hum[:, None], seed=seed, period=ONE_AXIS.period, **ONE_AXIS.truth)
    return replace(made, i_e=i_e)


def found(record, model=EXACT):
    return find_tones(model, RecordLines(model, Measured(record)))


@pytest.mark.parametrize("own", first_fast([ONE_AXIS, BENCHES["bench"]]), ids=["one axis", "two bearings"])
def test_pure_noise_has_no_tone(own):
    """Of 30 records; the mains is suspected from the start, and may come up once in a hundred records."""
    axes = own.rig.axes
    names = [*(f"K_i.{axis}" for axis in axes), *(f"K_s.{axis}" for axis in axes), "tau_e"]
    exact = Model(own.rig).with_values(dict(zip(names, (*own.K_i, *own.K_s, own.tau_e), strict=True)))
    i_e = own.excitation(own.amplitude)
    tones = []
    for seed in range(30):
        tones.append(found(simulate(own.rig, i_e, seed=seed, period=own.period, **own.truth, **own.noise), exact))
    assert not any(tone.power > OUTSTANDING for own in tones for tone in own)
    assert sum(map(len, tones)) <= 1


def test_a_peak_of_noise_is_no_tone():
    """As wide as two lines, and 30 dB high: single lines of it stand far above those beside."""
    own = BENCHES["bench"]
    axes = own.rig.axes
    names = [*(f"K_i.{axis}" for axis in axes), *(f"K_s.{axis}" for axis in axes), "tau_e"]
    exact = Model(own.rig).with_values(dict(zip(names, (*own.K_i, *own.K_s, own.tau_e), strict=True)))
    i_e = prbs(7, amplitude=own.amplitude, hold=1, axes=len(axes), periods=6)
    for seed in range(8):
        colour = [1.0], [1.0, -2.0 * 0.98 * np.cos(0.5 + 0.05 * seed), 0.98**2]
        record = simulate(own.rig, i_e, seed=seed, period=127, colour=colour, **own.truth, **own.noise)
        assert not any(tone.power > OUTSTANDING for tone in Noise(exact, [record]).tones[0])


@pytest.mark.parametrize(("line", "amplitude"), [(31.37, 0.05), (601.72, 0.2), (1234.61, 0.2)])
def test_a_hum_between_lines_is_found_to_two_thousandths_of_a_line(line, amplitude):
    """Noise alone moves hums of these sizes by less than half of that."""
    for seed in range(5):
        (tone,) = found(hummed((line * LINE, amplitude), seed=seed))
        assert tone.power > OUTSTANDING
        assert tone.frequency_hz / LINE == pytest.approx(line, abs=2e-3)


@pytest.mark.parametrize("amplitude", [0.02, 0.2])
def test_a_hum_is_told_once(amplitude):
    for seed in range(5):
        (tone,) = found(hummed((200.5 * LINE, amplitude), seed=seed))
        assert tone.frequency_hz / LINE == pytest.approx(200.5, abs=0.05)


def test_two_hums_are_found_strongest_first():
    tones = found(hummed((100.4 * LINE, 0.02), (140.3 * LINE, 0.01)))
    assert [tone.frequency_hz / LINE for tone in tones] == pytest.approx([100.4, 140.3], abs=0.02)
    assert tones[0].power > tones[1].power > OUTSTANDING


def test_two_hums_next_to_each_other_are_two():
    tones = sorted(tone.frequency_hz / LINE for tone in found(hummed((100.4 * LINE, 0.02), (108.7 * LINE, 0.02))))
    assert tones == pytest.approx([100.4, 108.7], abs=0.02)


def test_a_hum_on_an_excited_line_is_found_there():
    (tone,) = found(hummed((150 * LINE, 0.05)))
    assert tone.frequency_hz / LINE == pytest.approx(150.0, abs=0.3)


@pytest.mark.parametrize("off", [0.04, 0.053, 0.07, -0.2])
def test_a_hum_beside_an_excited_line_is_kept(off):
    """Little of it is left between, where tones are distinguished from peaks of noise."""
    record = hummed(((3 * 40 + off) * LINE, 3e-3))
    tones = Noise(EXACT, [record]).tones[0]
    assert len(tones) == 1
    assert tones[0].frequency_hz == pytest.approx((3 * 40 + off) * LINE, abs=0.25 * LINE)


def test_a_hum_that_a_rough_fit_hides_is_found_at_the_end():
    """Of a model that is off, the lines beside it are as loud."""
    near = 3 * 30 * LINE
    record, off = hummed((near, 3e-3)), EXACT.with_values({"K_s.A_zeta": 1.2 * ONE_AXIS.K_s[0]})
    noise = Noise(off, [record])
    assert noise.tones == [()]
    assert noise.misses_tone(EXACT)
    fit = identify(off, record)
    assert [tone.frequency_hz for tone in fit.comparison.noise.tones[0]] == [pytest.approx(near)]
    assert not fit.comparison.noise.misses_tone(fit.model)


def test_the_mains_is_suspected_and_found_where_it_is_small():
    """A tenth of what stands out by itself; and named by its own frequency, no nearby one."""
    sizes = []
    for seed in range(5):
        sizes += [tone for tone in found(hummed((50.0, 5e-4), seed=seed)) if abs(tone.frequency_hz - 50.0) < LINE]
    assert len(sizes) == 5


@pytest.mark.parametrize("seed", [1000, 1007])
def test_the_mains_is_judged_however_much_it_stands_out(seed):
    """Loud beside its neighbours, and not beside the spectrum of so few periods, which it has raised."""
    bench = replace(stranger(seed), order=7)
    for size in np.geomspace(200.0, 3e4, 8)[:3]:
        hum = find_size("periodic_disturbance", float(size), bench)
        rig, (record,), *_ = experiment_on(bench, {"periodic_disturbance": hum}, seed)
        (tones,) = compare(rig, record).noise.tones
        assert [tone.frequency_hz for tone in tones] == [pytest.approx(50.0, abs=0.5)], size


def test_a_turning_rotor_has_a_tone_at_its_speed_however_small():
    hz = 7.4 * 3 * LINE
    rig = ONE_AXIS.rig.replace(speed=2.0 * np.pi * hz)
    still = hummed()
    (tone,) = found(still, Model(rig).with_values({p.name: p.value for p in EXACT.parameters}))
    assert tone.frequency_hz == pytest.approx(hz)
    assert not found(still)


@pytest.mark.parametrize("line", [30.66, 100.4])
def test_a_hum_is_no_noise(line):
    """The noise of the excited lines is, but for a few percent, that of the same record without the hum."""
    with_hum, without = (Noise(EXACT, [record]).parts[0] for record in (hummed((line * LINE, 0.02)), hummed()))
    count = len(without.window.excited)
    ratio = with_hum.noise_power()[:count] / without.noise_power()[:count]
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    assert np.max(ratio) < 1.25


def first_periods(record, count, period):
    part = slice(0, count * period)
    return replace(record, i_e=record.i_e[part], y=record.y[part], i_c=record.i_c[part])


def test_of_two_settled_periods_only_what_is_suspected_is_told():
    assert found(first_periods(hummed((100.4 * LINE, 0.02)), 2, ONE_AXIS.period)) == ()
    assert [tone.frequency_hz for tone in found(first_periods(hummed((60.0, 0.02)), 2, ONE_AXIS.period))] == [60.0]


@pytest.mark.slow
def test_a_rotor_that_turns_has_its_tone_in_three_periods():
    bench = replace(BENCHES["small"], order=8)
    rig = bench.known_to(("unbalance",))
    hidden = {"unbalance": {"mass_eccentricity": 4e-6, "z": bench.middle, "phase": 0.7}}
    i_e = bench.excitation(bench.amplitude)[: 3 * bench.period]
    record = simulate(rig, i_e, hidden, seed=1, period=bench.period, **bench.truth, **bench.noise)
    few = [find(name) for name in ("unbalance", "foundation_resonance", "seal_forces")]
    result = diagnose(rig, record, catalogue=few)
    assert (result.verdict, result.effects) == ("explained", ("unbalance",))
