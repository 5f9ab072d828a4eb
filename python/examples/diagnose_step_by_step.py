"""Find the physics that a model lacks, and add it: first by hand, in small steps, then in one call."""

import ambid
from ambid.demo import DATA

rig = ambid.Rig.load(DATA / "rig.toml")
train = ambid.Record.load(DATA / "hidden_train.mat", rig)
validate = ambid.Record.load(DATA / "hidden_validate.mat", rig)  # at half the amplitude; no fit sees it

# The fit looks well, and the misfit says that it is not.
estimate = ambid.identify(rig, train)
comparison = ambid.compare(estimate.model, train)
fit, misfit = estimate.fit_percent["average"], comparison.records[0].misfit
print(f"fit {fit:.1f} %, but the residual has {misfit:.0f} times the power of noise")

# Where does it fail? In frequency and channel, and in which manner.
where = ambid.localise(comparison)
print(where.sentence())

# Which effect does the residual ask for? Nothing is refitted for this.
ranking = ambid.rank(comparison)
for candidate in ranking.candidates[:2]:
    print(f"{candidate.effect.name} would take the misfit to {candidate.predicted_misfit:.2f}")
    print(f"hard to distinguish from it: {', '.join(candidate.confusable_with) or 'nothing'}")

# Add each at its predicted value, fit everything again, and keep the better; then look at a record that was not used.
fits = [ambid.identify(estimate.model.add(own.effect, own.start), train) for own in ranking.candidates[:2]]
better, best = min(zip(fits, ranking.candidates, strict=False), key=lambda pair: pair[0].misfit)
for name in ("tau_e", "loop_delay.delay"):
    p = better.parameters[name]
    print(f"{name}: {p.value:.4g} {p.unit}, was {estimate.parameters[name].value if name == 'tau_e' else 0.0:.4g}")
print(f"misfit of the other record: {ambid.compare(better.model, validate).records[0].misfit:.2f}")

# The same in one call, with rivals refitted and a verdict; `write_report` makes a page of it.
found = ambid.diagnose(rig, train, validate=[validate])
print(found.verdict, *found.effects)
