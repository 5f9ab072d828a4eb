"""Errors of the record against the response whose channels are scaled, turned and exchanged in the record."""

import numpy as np
import pytest

from ambid.effects import CATALOGUE, Seen, find
from ambid.model import Model
from ambid.record import Record
from ambid.rig import StateSpaceController
from reference.loop_rigs import RIGS

READS_CURRENT = RIGS["analog"].replace(
    controller=StateSpaceController(
        implementation="analog",
        inputs=("y", "i_c"),
        A=-2e3 * np.eye(4),
        B=np.hstack([2e3 * np.eye(4), np.zeros((4, 4))]),
        C=-6e4 * np.eye(4),
        D=np.hstack([8e4 * np.eye(4), 0.3 * np.eye(4)]),
    )
)
MACHINES = {
    "analog": RIGS["analog, rotating"],
    "digital": RIGS["digital, delay 1.5, twice the rate"],
    "digital, rotating": RIGS["digital, delay 1, rotating"],
}
EXCHANGED = [3, 1, 2, 0]


def excitation(rig, samples=200):
    return 0.1 * np.random.default_rng(3).choice([-1.0, 1.0], (samples, len(rig.axes)))


def response(model, u):
    return model.loop.simulate(model.theta, u)


def record(rig, u):
    own, n = response(Model(rig), u), len(rig.axes)
    return Record("wrong", rig.sample_rate, rig.axes, u, own[:, :n], own[:, n:])


def column(k, factor):
    return np.where(np.arange(4) == k, factor, 1.0)


# effect, settings, values, and what it makes of y, i_c and the excitation that acts
WRONG = {
    "y of all": ("channel_gain", {"channel": "y"}, {"gain": 0.3}, {"y": lambda x: 1.3 * x}),
    "scale of one y": ("channel_gain", {"channel": "y.B_eta"}, {"gain": 0.3}, {"y": lambda x: column(3, 1.3) * x}),
    "one i_c": ("channel_gain", {"channel": "i_c.A_eta"}, {"gain": -0.2}, {"i_c": lambda x: column(1, 0.8) * x}),
    "one i_e": ("channel_gain", {"channel": "i_e.A_eta"}, {"gain": -0.2}, {"i_e": lambda x: column(1, 0.8) * x}),
    "sign of y": ("channel_sign", {"channel": "y"}, {}, {"y": lambda x: -x}),
    "sign of one i_c": ("channel_sign", {"channel": "i_c.B_zeta"}, {}, {"i_c": lambda x: column(2, -1.0) * x}),
    "sign of one i_e": ("channel_sign", {"channel": "i_e.B_zeta"}, {}, {"i_e": lambda x: column(2, -1.0) * x}),
    **{
        f"exchanged {signal}": (
            "channels_exchanged",
            {"signal": signal, "first": "A_zeta", "second": "B_eta"},
            {},
            {signal: lambda x: x[:, EXCHANGED]},
        )
        for signal in ("y", "i_c", "i_e")
    },
}


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("case", WRONG)
def test_the_record_alone_is_wrong(case, machine):
    """The loop, and what the controller reads, stay: so do its poles."""
    rig, (name, settings, values, makes) = MACHINES[machine], WRONG[case]
    u, same = excitation(rig), lambda x: x
    right = response(Model(rig), makes.get("i_e", same)(u))
    expected = np.hstack([makes.get("y", same)(right[:, :4]), makes.get("i_c", same)(right[:, 4:])])
    model = Model(rig).add(find(name, settings), values)
    found = response(model, u)
    assert np.abs(found - expected).max(axis=0) == pytest.approx(0.0, abs=1e-12 * np.abs(expected).max())
    assert model.simulator().run(u) == pytest.approx(found, abs=1e-10 * np.abs(expected).max())
    assert model.loop.outputs == Model(rig).loop.outputs
    np.testing.assert_allclose(np.sort(np.abs(model.poles())), np.sort(np.abs(Model(rig).poles())), rtol=1e-9)


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("case", WRONG)
def test_a_mended_record_is_the_right_one(case, machine):
    rig, (name, settings, values, _) = MACHINES[machine], WRONG[case]
    effect, u = find(name, settings), excitation(rig)
    wrong = Model(rig).add(effect, values).simulate(u)
    mended = effect.mended(wrong, values)
    expected = Model(rig).simulate(mended.i_e)
    for signal in ("y", "i_c"):
        own = getattr(expected, signal)
        assert getattr(mended, signal) == pytest.approx(own, abs=1e-12 * np.abs(own).max())


@pytest.mark.parametrize("machine", MACHINES)
def test_one_beside_the_other(machine):
    """Cables, polarity, scale, in this order: each is of the column that it names."""
    rig, u = MACHINES[machine], excitation(MACHINES[machine])
    right = response(Model(rig), u)
    model = Model(rig).add(find("channel_gain", {"channel": "y.B_eta"}), {"gain": 0.5})
    model = model.add(find("channel_sign", {"channel": "y.B_eta"}))
    model = model.add(find("channels_exchanged", {"signal": "y", "first": "A_zeta", "second": "B_eta"}))
    expected = np.hstack([column(3, -1.5) * right[:, EXCHANGED], right[:, 4:]])
    assert response(model, u) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


def test_a_controller_that_reads_the_current_reads_the_true_one():
    rig = READS_CURRENT
    assert Model(rig).is_stable
    u = excitation(rig)
    right = response(Model(rig), u)
    model = Model(rig).add(find("channel_gain", {"channel": "i_c"}), {"gain": 0.5})
    expected = np.hstack([right[:, :4], 1.5 * right[:, 4:]])
    assert response(model, u) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("channel", ["y", "i_c.A_eta", "i_e.A_eta"])
def test_a_gain_is_linear_so_that_its_score_foretells_the_refit(machine, channel):
    rig, u = MACHINES[machine], excitation(MACHINES[machine])
    absent, large = (Model(rig).add(find("channel_gain", {"channel": channel}), {"gain": gain}) for gain in (0.0, 2.0))
    free = [absent.names.index("channel_gain.gain")]
    y, slopes = absent.loop.sensitivity(absent.theta, u, free)
    expected = response(large, u)
    assert y + 2.0 * slopes[:, :, 0] == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())
    f = np.geomspace(3.0, 3000.0, 12)
    excited = np.ones((len(f), len(absent.loop.inputs)), dtype=complex)
    on_lines = absent.loop.frequency_slopes(absent.theta, f, excited, free)[:, :, 0]
    change = (
        large.loop.frequency_response(large.theta, f) - absent.loop.frequency_response(absent.theta, f)
    ) @ np.ones(len(absent.loop.inputs))
    assert 2.0 * on_lines == pytest.approx(change, abs=1e-8 * np.abs(change).max())


def test_every_channel_is_tried_once():
    seen = Seen(RIGS["analog"], {})
    signs = [own.channel for own in find("channel_sign").variants(seen)]
    assert len(signs) == len(set(signs)) == 3 * (1 + 4)
    assert "i_e" not in [own.channel for own in find("channel_gain").variants(seen)]  # excitation_gain_error is that
    assert len(set(find("channels_exchanged").variants(seen))) == 3 * 6
    one = Seen(RIGS["analog, one axis"], {})
    assert [own.channel for own in find("channel_sign").variants(one)] == ["y", "i_c", "i_e"]
    assert find("channels_exchanged").why_not(RIGS["analog, one axis"])


def test_errors_of_the_record_are_no_part_of_the_loop():
    names = {effect.name for effect in CATALOGUE if effect.in_record}
    assert names == {
        "channel_delay",
        "channel_gain",
        "channel_sign",
        "channels_exchanged",
        "excitation_gain_error",
    }


@pytest.mark.parametrize(("samples", "period"), [(0.37, 127), (-2.6, 127), (1.4, None)])
def test_a_channel_that_was_late_is_moved(samples, period):
    """Of a sum of sines."""
    rig = RIGS["analog, one axis"]
    t, turns = np.arange(4 * 127), 2.0 * np.pi * np.array([3.0, 11.0, 20.0]) / 127

    def signal(t):
        return np.cos(np.outer(t, turns) + [0.1, 1.0, 2.0]).sum(axis=1)[:, None]

    wrong = Record("late", rig.sample_rate, rig.axes, signal(t), signal(t - samples), signal(t), period=period)
    found = find("channel_delay").mended(wrong, {"delay": samples / rig.sample_rate})
    lost = 0 if period else int(np.ceil(abs(samples)))
    assert len(found.y) == len(t) - lost
    kept = slice(None) if period else slice(60, -60)  # beyond the ends nothing is known
    np.testing.assert_allclose(found.y[kept], signal(t)[: len(found.y)][kept], atol=1e-9 if period else 0.05)
    np.testing.assert_allclose(found.i_e, signal(t)[: len(found.y)], atol=1e-12)
