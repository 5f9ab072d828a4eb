"""Units of Universal Files: set 164, specific data types, labels, abscissas; written by pyuff, against closed forms."""

import numpy as np
import pytest

from ambid import ChannelMap, FrequencyResponse, Rig
from ambid.errors import RecordError
from ambid.record.quantities import frequency_unit, ratio_of, unit_of
from found import codes, the
from places import LEVITATOR

pyuff = pytest.importorskip("pyuff")

RIG = Rig.load(LEVITATOR)
AXIS = RIG.axes[0]
Y, I_C, I_E = f"y.{AXIS}", f"i_c.{AXIS}", f"i_e.{AXIS}"
F = np.arange(20.0, 820.0, 20.0)
S = 2j * np.pi * F
H = 30.0 / (S**2 + 120.0 * S + 4e5)
"""y by i_e [m/A]."""
CURRENT = 1.0 / (1.0 + 1e-3 * S)
"""i_c by i_e."""
DISPLACEMENT, FORCE, PRESSURE, VELOCITY, ACCELERATION = 8, 13, 15, 11, 12


def unit_set(length):
    return pyuff.prepare_164(
        units_code=9, units_description="own", temp_mode=1, length=length, force=1.0, temp=1.0, temp_offset=0.0
    )


def response_set(data, *, kind=DISPLACEMENT, label="NONE", below="NONE", names=(Y, I_E), x=F, **further):
    abscissa = {"abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz", **further}
    return pyuff.prepare_58(
        **{f"id{k}": "NONE" for k in range(1, 6)},
        binary=0,
        func_type=4,
        ord_data_type=6,
        abscissa_spacing=0,
        rsp_node=1,
        rsp_dir=3,
        ref_node=1,
        ref_dir=3,
        rsp_ent_name=names[0],
        ref_ent_name=names[1],
        ordinate_spec_data_type=kind,
        ordinate_axis_units_lab=label,
        orddenom_spec_data_type=FORCE,
        orddenom_axis_units_lab=below,
        data=data,
        x=x,
        **abscissa,
    )


def load(folder, *sets, **options):
    file = pyuff.UFF(str(folder / "frf.uff"))
    for own in sets:
        file.write_sets(own, "add")
    return FrequencyResponse.load(folder / "frf.uff", RIG, **options)


MEASURED = {
    "m": (H, DISPLACEMENT, "m", None),
    "mm": (1e3 * H, DISPLACEMENT, "mm", None),
    "um": (1e6 * H, DISPLACEMENT, "um", None),
    "mil": (H / 25.4e-6, DISPLACEMENT, "mil", None),
    "a ratio": (1e3 * H, DISPLACEMENT, "mm/A", None),
    "mm by set 164": (1e3 * H, DISPLACEMENT, "NONE", 1e3),
    "inch by set 164": (H / 0.0254, DISPLACEMENT, "NONE", 1.0 / 0.0254),
    "m/s": (S * H, VELOCITY, "m/s", None),
    "m/s without a label": (S * H, VELOCITY, "NONE", None),
    "mm/s": (1e3 * S * H, VELOCITY, "mm/s", None),
    "mm/s by set 164": (1e3 * S * H, VELOCITY, "NONE", 1e3),
    "in/s": (S * H / 0.0254, VELOCITY, "in/s", None),
    "m/s^2": (S**2 * H, ACCELERATION, "m/s^2", None),
    "m/s2 of any type": (S**2 * H, 1, "m/s2", None),
    "mm/s^2 by set 164": (1e3 * S**2 * H, ACCELERATION, "NONE", 1e3),
    "g": (S**2 * H / 9.80665, ACCELERATION, "g", None),
    "g by A": (S**2 * H / 9.80665, ACCELERATION, "g/A", None),
}


@pytest.mark.parametrize("name", MEASURED)
def test_every_motion_is_made_metres(tmp_path, name):
    data, kind, label, length = MEASURED[name]
    units = [] if length is None else [unit_set(length)]
    found = load(tmp_path, *units, response_set(data, kind=kind, label=label))
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)
    assert ("units_converted" in codes(found)) == (name != "m")
    assert "units_contradict" not in codes(found)


def test_currents_are_none_of_the_lengths_of_set_164(tmp_path):
    sets = [response_set(1e3 * H), response_set(CURRENT, names=(I_C, I_E))]
    found = load(tmp_path, unit_set(1e3), *sets)
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)
    np.testing.assert_allclose(found.response[:, 1, 0], CURRENT, rtol=1e-9)


def test_milliamperes_above_and_below(tmp_path):
    sets = [response_set(1e-3 * H, below="mA"), response_set(CURRENT, label="mA", below="mA", names=(I_C, I_E))]
    found = load(tmp_path, *sets)
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)
    np.testing.assert_allclose(found.response[:, 1, 0], CURRENT, rtol=1e-9)


@pytest.mark.parametrize(
    ("label", "kind", "factor"), [("rad/s", 18, 2.0 * np.pi), ("rpm", 18, 60.0), ("NONE", 19, 60.0), ("kHz", 18, 1e-3)]
)
def test_the_unit_of_the_abscissa(tmp_path, label, kind, factor):
    data = response_set(S * H, kind=VELOCITY, x=factor * F, abscissa_axis_units_lab=label, abscissa_spec_data_type=kind)
    found = load(tmp_path, data)
    np.testing.assert_allclose(found.frequency_hz, F, rtol=1e-5)  # a file holds six digits of them
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-5)


def test_a_line_at_zero_is_no_displacement(tmp_path):
    f = np.insert(F, 0, 0.0)
    found = load(tmp_path, response_set(np.insert(S * H, 0, 0.0), kind=VELOCITY, x=f))
    assert found.frequency_hz[0] == F[0]
    assert "zero_frequency_not_used" in codes(found)


def test_a_label_that_contradicts_set_164_counts(tmp_path):
    found = load(tmp_path, unit_set(1.0), response_set(1e3 * H, label="mm"))
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)
    shown = the(found, "units_contradict")
    assert (shown.severity, shown.values["factor"], shown.values["of_164"]) == ("warning", 1e-3, 1.0)


def test_a_factor_of_the_map_replaces_the_unit_of_the_file(tmp_path):
    own = response_set(1e3 * H, label="mm", names=("NONE", "NONE"))
    named = {Y: "1+Z:1e-3", I_E: "1+Z"}
    with pytest.raises(RecordError):  # response and excitation have one name
        load(tmp_path, own, mapping=named)
    found = load(
        tmp_path, response_set(1e3 * H, label="mm", names=("probe", "coil")), mapping={Y: "probe:1e-3", I_E: "coil"}
    )
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)
    assert "map_replaces_units" in codes(found)


def test_a_map_without_a_factor_keeps_the_unit_of_the_file(tmp_path):
    mapping = ChannelMap({Y: "probe", I_E: "coil"})
    found = load(tmp_path, response_set(1e3 * H, label="mm", names=("probe", "coil")), mapping=mapping)
    np.testing.assert_allclose(found.response[:, 0, 0], H, rtol=1e-9)


REFUSED = {
    "a pressure": {"kind": PRESSURE},
    "an unknown type": {"kind": 0},
    "an unknown unit": {"label": "furlong"},
    "a velocity in m": {"kind": VELOCITY, "label": "m"},
    "a current of a displacement": {"label": "A"},
    "by a force": {"below": "N"},
    "by a voltage": {"below": "V"},
    "by a length": {"below": "mm"},
    "a current as an acceleration": {"kind": ACCELERATION, "names": (I_C, I_E)},
    "a current in metres": {"label": "mm", "names": (I_C, I_E)},
    "over time": {"abscissa_spec_data_type": 17, "abscissa_axis_units_lab": "s"},
    "over orders": {"abscissa_axis_units_lab": "order"},
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_unknown_is_refused_with_its_data_set(tmp_path, name, golden):
    with golden.raises(RecordError):
        load(tmp_path, unit_set(1.0), response_set(H, **REFUSED[name]))


def test_a_length_of_nothing_is_refused(tmp_path, golden):
    with golden.raises(RecordError):
        load(tmp_path, unit_set(0.0), response_set(H))


@pytest.mark.parametrize(
    ("text", "kind", "factor"),
    [
        ("µm", "displacement", 1e-6),
        ("MILS", "displacement", 25.4e-6),
        ("(mm/s)", "velocity", 1e-3),
        ("ips", "velocity", 0.0254),
        ("m/s²", "acceleration", 1.0),
        ("m/s**2", "acceleration", 1.0),
        ("in/sec^2", "acceleration", 0.0254),
        ("mg", "acceleration", 9.80665e-3),
        ("mA", "current", 1e-3),
    ],
)
def test_units_in_many_ways_of_writing(text, kind, factor):
    found = unit_of(text)
    assert (found.kind, found.factor) == (kind, pytest.approx(factor))


def test_ratios_and_unknown_units():
    upper, lower = ratio_of("(m/s^2)/mA")
    assert (upper.kind, lower.factor) == ("acceleration", 1e-3)
    assert ratio_of("m/furlong") is None
    assert frequency_unit("furlong") is None
