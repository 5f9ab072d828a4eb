"""Start times, sample times and names of TDMS channels, as npTDMS writes them."""

import numpy as np
import pytest

from ambid import Record, Rig
from ambid.errors import RecordError
from found import codes, the
from places import LEVITATOR

nptdms = pytest.importorskip("nptdms")

RIG = Rig.load(LEVITATOR)
AXIS, RATE = RIG.axes[0], RIG.sample_rate
STEP = 1.0 / RATE
I_E, Y, I_C = (f"{signal}.{AXIS}" for signal in ("i_e", "y", "i_c"))
RNG = np.random.default_rng(5)
SAMPLES = {
    I_E: np.tile(0.1 * np.sign(RNG.standard_normal(200)), 4),
    Y: 1e-5 * RNG.standard_normal(800),
    I_C: 0.1 * RNG.standard_normal(800),
}
BEGIN = np.datetime64("2026-05-01T10:00:00.000000")


def write(path, channels, groups=None):
    """Channels of a file by name: values and properties."""
    objects = [
        nptdms.ChannelObject((groups or {}).get(name, "rec"), name.rpartition("/")[2], values, properties)
        for name, (values, properties) in channels.items()
    ]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(objects)
    return path


def timed(start_s=0.0, offset_s=0.0, step=STEP):
    microseconds = np.timedelta64(round(1e6 * start_s), "us")
    return {"wf_increment": step, "wf_start_offset": offset_s, "wf_start_time": BEGIN + microseconds}


def late(samples, name=Y, **timing):
    """Channels of which one begins some samples later than the others, and says so."""
    return {
        other: (values[samples:], timed(**timing)) if other == name else (values, timed())
        for other, values in SAMPLES.items()
    }


@pytest.mark.parametrize("name", [I_E, Y])
@pytest.mark.parametrize("key", ["start_s", "offset_s"])
def test_channels_are_put_at_common_instants(tmp_path, key, name):
    record = Record.load(write(tmp_path / "run.tdms", late(30, name, **{key: 30 * STEP})), RIG)
    assert record.samples == 770
    for signal, channel in (("i_e", I_E), ("y", Y), ("i_c", I_C)):
        np.testing.assert_array_equal(getattr(record, signal)[:, 0], SAMPLES[channel][30:])
    shown = the(record, "channels_aligned")
    assert (shown.severity, shown.values["samples"]) == ("note", 770)
    assert shown.values["start_s"][name] == pytest.approx(30 * STEP)


def test_start_and_offset_add_up(tmp_path):
    channels = late(30, start_s=20 * STEP, offset_s=10 * STEP)
    np.testing.assert_array_equal(Record.load(write(tmp_path / "run.tdms", channels), RIG).y[:, 0], SAMPLES[Y][30:])


def test_offsets_alone_are_from_one_start(tmp_path):
    channels = late(30, offset_s=30 * STEP)
    for _, properties in channels.values():
        del properties["wf_start_time"]
    del channels[I_C][1]["wf_start_offset"]
    record = Record.load(write(tmp_path / "run.tdms", channels), RIG)
    np.testing.assert_array_equal(record.y[:, 0], SAMPLES[Y][30:])
    np.testing.assert_array_equal(record.i_c[:, 0], SAMPLES[I_C][30:])


def test_a_map_aligns_them_too(tmp_path):
    path = write(tmp_path / "run.tdms", late(30, start_s=30 * STEP))
    mapping = {I_E: I_E, Y: Y}
    np.testing.assert_array_equal(Record.load(path, RIG, mapping=mapping).y[:, 0], SAMPLES[Y][30:])


def test_a_fraction_of_a_sample_is_told_and_stays(tmp_path):
    record = Record.load(write(tmp_path / "run.tdms", late(0, I_C, offset_s=0.3 * STEP)), RIG)
    np.testing.assert_array_equal(record.i_c[:, 0], SAMPLES[I_C])
    shown = the(record, "channels_apart")
    assert (shown.severity, shown.values["reference"], shown.values["channels"]) == ("warning", Y, [I_C])
    assert shown.values["late_s"][I_C] == pytest.approx(0.3 * STEP)
    assert shown.values["late_samples"][I_C] == pytest.approx(0.3)


@pytest.mark.parametrize("timing", [{"wf_increment": STEP}, timed()], ids=["none", "one"])
def test_channels_of_one_start_are_as_they_were(tmp_path, timing):
    record = Record.load(write(tmp_path / "run.tdms", {k: (v, timing) for k, v in SAMPLES.items()}), RIG)
    np.testing.assert_array_equal(record.y[:, 0], SAMPLES[Y])
    assert codes(record) == []


def broken(name):
    whole = {channel: (values, timed()) for channel, values in SAMPLES.items()}
    return (
        whole
        | {
            "several sample times": {Y: (SAMPLES[Y], timed(step=2.0 * STEP))},
            "nothing in common": {Y: (SAMPLES[Y], timed(start_s=1.0))},
            "one without a start": {Y: (SAMPLES[Y], timed(start_s=0.01)), I_C: (SAMPLES[I_C], {"wf_increment": STEP})},
        }[name]
    )


@pytest.mark.parametrize("name", ["several sample times", "nothing in common", "one without a start"])
def test_times_that_have_no_sense_are_refused(tmp_path, name, golden):
    with golden.raises(RecordError):
        Record.load(write(tmp_path / "run.tdms", broken(name)), RIG)


def test_channels_that_are_not_used_may_have_another_sample_time(tmp_path):
    channels = {name: (values, timed()) for name, values in SAMPLES.items()}
    channels["temperature"] = (np.ones(8), timed(start_s=5.0, step=0.01))
    record = Record.load(write(tmp_path / "run.tdms", channels), RIG)
    assert (record.samples, record.sample_rate) == (800, RATE)
    assert the(record, "columns_not_used").values["names"] == ["temperature"]


def test_a_name_that_is_unique_needs_no_group(tmp_path):
    channels = {name: (values, timed()) for name, values in SAMPLES.items()} | {"T": (np.ones(8), {})}
    path = write(tmp_path / "run.tdms", channels, {"T": "slow"})
    for mapping in (None, {I_E: I_E, Y: Y}, {I_E: f"rec/{I_E}", Y: f"rec/{Y}"}):
        np.testing.assert_array_equal(Record.load(path, RIG, mapping=mapping).y[:, 0], SAMPLES[Y])


def test_a_name_of_the_only_group_may_have_it(tmp_path):
    path = write(tmp_path / "run.tdms", {name: (values, timed()) for name, values in SAMPLES.items()})
    found = Record.load(path, RIG, mapping={I_E: f"rec/{I_E}", Y: f"rec/{Y}"})
    np.testing.assert_array_equal(found.y[:, 0], SAMPLES[Y])


def test_a_name_of_two_groups_needs_it(tmp_path, golden):
    channels = {name: (values, timed()) for name, values in SAMPLES.items()} | {f"other/{Y}": (SAMPLES[Y], timed())}
    path = write(tmp_path / "run.tdms", channels, {f"other/{Y}": "other"})
    with golden.raises(RecordError):
        Record.load(path, RIG, mapping={I_E: I_E, Y: Y})


def test_a_name_of_two_groups_is_ambiguous(tmp_path, golden):
    groups = {f"Log/{name}": "Log" for name in SAMPLES} | {f"Old/{Y}": "Old"}
    channels = {f"Log/{name}": (values, timed()) for name, values in SAMPLES.items()}
    path = write(tmp_path / "run.tdms", channels | {f"Old/{Y}": (SAMPLES[Y][::-1].copy(), timed())}, groups)
    with golden.raises(RecordError):
        Record.load(path, RIG)
    with golden.raises(RecordError):
        Record.load(path, RIG, mapping={name: name for name in SAMPLES})
    record = Record.load(path, RIG, mapping={I_E: I_E, I_C: I_C, Y: f"Log/{Y}"})
    np.testing.assert_array_equal(record.y[:, 0], SAMPLES[Y])
