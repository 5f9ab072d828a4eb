"""What further signals bring to an experiment: against records of the independent simulator, of these lengths."""

from dataclasses import replace

import numpy as np
import pytest

from ambid.designs import Instruments, design, prospect
from ambid.designs.length import DECISIVE, NOT_KNOWN, SHORTER
from ambid.designs.powers import criterion
from ambid.errors import InputError, ModelError
from ambid.identification import identify
from ambid.model import Model
from ambid.noise import compare
from ambid.rig import Rig
from ambid.rig.tolerance import TYPICAL
from hidden.bench import measured
from hidden.one_axis import ONE_AXIS
from tiers import first_fast

NOISE = {"b.A_zeta": 1e-3, "f.A_zeta": 0.3, "a.mass": 0.02, "y.other": 2e-8}
"""White, of each instrument."""
Y, I_C = 50e-9, 5e-3


def instrumented() -> Rig:
    data = ONE_AXIS.rig.model_dump(by_alias=True, exclude_none=True)
    data["sensor"] = [{"signal": "a", "name": "mass"}, {"signal": "y", "name": "other"}]
    (bearing,) = data["bearing"]
    flux = float(np.sqrt(4e-7 * np.pi * ONE_AXIS.K_i[0] * bearing["bias_current"] / (4.0 * 3e-4)))
    bearing |= {"pole_area": 3e-4, "bias_flux": flux}
    return Rig(**data)


MASS = instrumented().replace(tolerance={"exact": True})
TRUE = Model(MASS).with_values({"K_i.A_zeta": ONE_AXIS.K_i[0], "K_s.A_zeta": ONE_AXIS.K_s[0], "tau_e": ONE_AXIS.tau_e})


def stated(*names: str) -> Instruments:
    return Instruments.stated(1, Y, I_C, {name: NOISE[name] for name in names})


def variance(planned, names) -> float:
    """Mean relative variance of an identification of the machine by a planned record (D-criterion)."""
    further = {name: NOISE[name] for name in names}
    own = measured(MASS, planned.i_e, {}, seed=1, sensor_noise=Y, current_noise=I_C, further=further, **ONE_AXIS.truth)
    found = identify(MASS, replace(own, period=len(planned.option.wave)))
    scale = np.array([p.value for p in found.parameters.values()])
    return criterion(np.asarray(np.linalg.inv(found.covariance / np.outer(scale, scale))), None)


@pytest.mark.parametrize("name", first_fast(["b.A_zeta", "f.A_zeta", "a.mass", "y.other"]))
def test_a_record_without_a_signal_is_as_accurate_after_the_time_that_is_told(name, validated):
    signal = name.partition(".")[0]
    beside = design(TRUE, stated(name), seconds=1.0, signal="multisine")
    told = beside.without[signal]
    assert told > 1.2 * beside.forecast.seconds
    (finding,) = (own for own in beside.findings if own.kind in (SHORTER, DECISIVE))
    assert (finding.where.channel, finding.values["without_s"]) == (signal, told)
    assert finding.values["with_s"] == beside.forecast.seconds
    alone = design(TRUE, stated(), seconds=told, signal="multisine")
    shorter, longer = variance(beside, (name,)), variance(alone, ())
    validated(
        "Time without a further signal for the same accuracy, of b, f, a, y: relative deviation",
        "variances of identifications of the independent simulator's records of both lengths",
        longer * alone.forecast.seconds / told / shorter - 1.0,
        0.2,
    )


@pytest.mark.slow
def test_a_wanted_accuracy_takes_less_time_and_a_signal_in_loud_noise_brings_nothing():
    wanted = {"K_i": "0.002%"}
    beside = design(TRUE, stated("b.A_zeta", "f.A_zeta"), accuracy=wanted, signal="multisine")
    assert list(beside.without) == ["b", "f"]
    for name, kept in (("b", "f.A_zeta"), ("f", "b.A_zeta")):
        alone = design(TRUE, stated(kept), accuracy=wanted, signal="multisine")
        assert beside.without[name] == alone.forecast.seconds >= beside.forecast.seconds
    assert beside.to_json()["seconds_without"] == beside.without
    loud = design(TRUE, Instruments.stated(1, Y, I_C, {"b.A_zeta": 10.0}), seconds=1.0, signal="multisine")
    assert loud.without["b"] == pytest.approx(loud.forecast.seconds, rel=0.02)


def test_where_the_mass_is_known_to_two_percent_a_load_cell_alone_gives_force_per_current():
    """K_i is in proportion to the mass: by y, i_c and i_e it is known to 1.96 times 2 %, whatever the length."""
    known = TRUE.rig.replace(tolerance={**dict.fromkeys(TYPICAL, 0.0), "mass": 0.02})
    found = design(known, stated("f.A_zeta"), accuracy={"K_i": "1%"}, signal="multisine")
    assert found.without == {"f": np.inf}
    assert found.to_json()["seconds_without"] == {"f": None}
    assert [own.kind for own in found.findings if own.where.channel == "f"] == [DECISIVE]
    assert 1.96 * found.prospect.parameters["K_i.A_zeta"].std_error < found.wanted["K_i.A_zeta"]


def test_signals_of_the_rig_whose_noise_is_not_known_are_named():
    found = [
        own for own in design(TRUE, stated("b.A_zeta"), seconds=0.5, signal="prbs").findings if own.kind is NOT_KNOWN
    ]
    assert {own.where.channel: own.values["channels"] for own in found} == {"a": ["a.mass"], "y": ["y.other"]}
    assert not design(ONE_AXIS.rig, stated(), seconds=0.5, signal="prbs").without


def test_a_record_without_y_tells_the_noise_of_what_it_has_and_options_that_of_more():
    """Accelerations and currents alone; the channels are known by their names, not by their number."""
    i_e = ONE_AXIS.excitation(1.0)
    own = measured(MASS, i_e, {}, seed=2, sensor_noise=Y, current_noise=I_C, further={"a.mass": 0.02}, **ONE_AXIS.truth)
    own = replace(own, period=ONE_AXIS.period, y=np.empty((own.samples, 0)))
    told = Instruments.of(compare(TRUE, own))
    assert told.names(MASS.axes) == ("i_c.A_zeta", "a.mass")
    seen = prospect(TRUE, i_e, period=ONE_AXIS.period, instruments=told).parameters
    for name, parameter in identify(TRUE, own).parameters.items():
        assert seen[name].std_error == pytest.approx(parameter.std_error, rel=0.2), name
    more = told.beside({"b.A_zeta": 1e-3, "y": Y})
    assert more.names(MASS.axes) == ("y.A_zeta", "i_c.A_zeta", "a.mass", "b.A_zeta")
    kept = more.without("b.A_zeta", "y")
    assert kept.names(MASS.axes) == told.names(MASS.axes)
    np.testing.assert_array_equal(kept.covariance, told.covariance)
    better = prospect(TRUE, i_e, period=ONE_AXIS.period, instruments=more).parameters
    assert all(better[name].std_error < seen[name].std_error for name in seen)


def test_noise_of_channels_refuses(golden):
    with golden.raises(InputError):
        stated("b.A_zeta").beside({"b.A_zeta": 1e-3})
    with golden.raises(InputError):
        Instruments(np.zeros(1), np.ones((1, 1, 1), dtype=complex)).names(MASS.axes)
    with golden.raises(ModelError):
        design(ONE_AXIS.rig, stated("b.A_zeta"), seconds=0.5)
