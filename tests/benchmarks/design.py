"""What is foreseen of experiments, held against virtual ones: standard errors, the gain of the best powers, and sizes.

python tests/benchmarks/design.py errors 500     standard errors foreseen and found, best multisine and usual PRBS
python tests/benchmarks/design.py sizes 200      how often effects of the smallest visible size are named
python tests/benchmarks/design.py next 20        ambiguous pairs, and whether the proposed experiment separates them
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import ambid
from ambid.designs import Instruments, design, forecast, prospect, tell_apart, visible
from ambid.identification.minimum import refit

LEVITATOR = Path(__file__).parents[1] / "data" / "levitator.toml"
SENSOR, CURRENT = 2e-7, 0.01
EFFECTS = ("loop_delay", "sensor_lag", "eddy_currents", "excitation_gain_error", "force_nonlinearity", "sampling_skew")


def record_of(model, i_e, period, seed):
    found = model.virtual_experiment(i_e, sensor_noise=SENSOR, current_noise=CURRENT, seed=seed)
    return replace(found, period=period)


def errors(runs):
    rig = ambid.Rig.load(LEVITATOR)
    model, stated = ambid.Model(rig), Instruments.stated(1, SENSOR, CURRENT)
    best = design(rig, stated, seconds=0.82)
    usual = ambid.prbs(9, amplitude=1.0, hold=2, periods=8)
    usual *= best.forecast.axes[0].i_c / forecast(rig, usual, period=1022).axes[0].i_c
    volumes = []
    for name, i_e, period in (("best", best.i_e, len(best.option.wave)), ("usual prbs", usual, 1022)):
        shown = prospect(model, i_e, period=period, instruments=stated)
        values = []
        for seed in range(runs):
            fit = ambid.identify(rig, record_of(model, i_e, period, seed))
            values.append([p.value for p in fit.parameters.values()])
        found = np.cov(np.array(values).T)
        ratio = np.sqrt(np.diag(found) / np.diag(shown.covariance))
        volumes.append(np.linalg.det(found / np.outer(model.theta, model.theta)) ** (1 / 3) * shown.seconds)
        axis = forecast(rig, i_e, period=period).axes[0]
        peaks = f"i_c {axis.i_c:.3g} A, y {1e6 * axis.y:.3g} um"
        print(f"{name}: {shown.seconds:.3g} s, peaks {peaks}; found over foreseen", *(f"{r:.3f}" for r in ratio))
    print(f"time of the usual PRBS over that of the best, for equal accuracy: {volumes[1] / volumes[0]:.2f}")


def sizes(runs):
    rig = ambid.Rig.load(LEVITATOR)
    model, stated = ambid.Model(rig), Instruments.stated(1, SENSOR, CURRENT)
    for name in EFFECTS:
        loud = 1.0 if name == "force_nonlinearity" else 0.3
        i_e = ambid.prbs(8, amplitude=loud, hold=2, periods=8)
        period = len(i_e) // 8
        own = visible(prospect(model, i_e, period=period, instruments=stated).comparison).find(name)
        truth = model.add(ambid.effects.find(name, own.settings), {own.parameter: own.size})
        significant, in_set, verdicts = 0, 0, {}
        for seed in range(runs):
            record = record_of(truth, i_e, period, seed)
            ranking = ambid.rank(ambid.identify(rig, record).comparison)
            significant += ranking.find(name) in ranking.significant
            end = ambid.diagnose(rig, record)
            in_set += name in end.effects or any(name in names for names in end.ambiguous_sets)
            verdicts[end.verdict] = verdicts.get(end.verdict, 0) + 1
        chance = 100 * 1.96 * np.sqrt(0.25 / runs)
        print(
            f"{name}, {own.parameter} {own.size:.3g} {own.unit}: significant {100 * significant / runs:.0f} %, "
            f"in the reported set {100 * in_set / runs:.0f} % (50 +- {chance:.0f} % by chance); {verdicts}",
            flush=True,
        )


def cases():
    """Three pairs that a record leaves ambiguous, whether i_c is recorded, and the values that both ask for."""
    model = ambid.Model(ambid.Rig.load(LEVITATOR))
    nothing = {"proportional": 0.0, "integral": 0.0}
    gain = {**nothing, "derivative": 0.008}
    yield (
        True,
        {
            "back_emf": model.add("back_emf", {"current_per_velocity": 0.3}),
            "controller_gain_error": model.add("controller_gain_error", gain),
        },
    )
    yield (
        False,
        {
            "loop_delay": model.add("loop_delay", {"delay": 1e-5}),
            "sensor_lag": model.add("sensor_lag", {"time_constant": 1e-5}),
        },
    )
    yield (
        True,
        {
            "eddy_currents": model.add("eddy_currents", {"root_time_constant": 6e-4}),
            "controller_gain_error": model.add("controller_gain_error", {**nothing, "derivative": -0.004}),
        },
    )


def next_experiment(runs):
    i_e = ambid.prbs(8, amplitude=0.2, hold=2, periods=8)
    period, both = len(i_e) // 8, Instruments.stated(1, SENSOR, CURRENT)
    for currents, pair in cases():
        shown = both if currents else both.without_currents()
        found = tell_apart(pair, i_e, period, shown, more_instruments=None if currents else both)
        best = found.best
        longer = np.tile(i_e, (int(np.ceil(best.repeats)), 1))
        before, after, count = 0, 0, 0
        for name, truth in pair.items():
            for seed in range(runs):
                old = record_of(truth, i_e, period, 2 * seed)
                new = record_of(best.change.at(truth), best.change.amplitude * longer, period, 2 * seed + 1)
                if not currents:
                    old = replace(old, i_c=None)
                    new = new if "i_c" in best.change.record else replace(new, i_c=None)
                before += _likelier(pair, [old]) == name
                after += _likelier(pair, [old, new]) == name
                count += 1
        print(
            f"{', '.join(pair)}: {best.change.what}, {best.repeats:.3g} times as long; "
            f"likelier is the truth before {100 * before / count:.0f} %, with it "
            f"{100 * after / count:.0f} % of {count}",
            flush=True,
        )


def _likelier(pair, records):
    """Which hypothesis leaves less, in one noise."""
    fit = ambid.identify(next(iter(pair.values())), records).comparison
    costs = {name: refit(fit.of(model)).cost - len(model.names) for name, model in pair.items()}
    return min(costs, key=lambda name: costs[name])


if __name__ == "__main__":
    {"errors": errors, "sizes": sizes, "next": next_experiment}[sys.argv[1]](int(sys.argv[2]))
