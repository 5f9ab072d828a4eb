"""The rate-independent loop that dry friction and iron share."""

from collections.abc import Mapping, Sequence

from ambid.loop.assembly import Signal
from ambid.loop.effect import Effect, EffectParameter
from ambid.loop.plant import Plant

CREEP = 1e-6
"""Rate at which what sticks creeps [1/s], over far longer than any record: the loop at rest then has no pole at 0."""
ROUNDED_RATE, ROUNDED_STATE = 0.003, 0.01
"""Parts of the largest rate and of the largest state within which their sizes are rounded."""
SHARPEST = 20.0
"""Largest exponent: of a slider on a spring less than a thousandth is left."""


def gradual() -> EffectParameter:
    """How gradually it begins to slip: from 1 of Dahl's law down to a slider on a spring."""
    return EffectParameter(
        "inverse_exponent",
        "1",
        0.5,
        lower=1.0 / SHARPEST,
        upper=1.0,
        meaning="1/n: 1 where it begins to slip gradually, near 0 where it sticks like a spring until it slips",
    )


def drawn_along(
    plant: Plant, effect: Effect, rates: Mapping[str, Signal], fastest: float
) -> Sequence[tuple[Signal, Signal]]:
    """The state h of Bouc and Wen: ``h' = 2 (u' - |v| |h|^(n-1) h)/width``, ``v = u' h/|h|``.

    With n = 1 it is Dahl's law, with n without limit a slider on a spring; rounded where it turns. Of several
    coordinates the vector h slips in the direction of u, whatever their axes are.

    Parameters
    ----------
    plant : Plant
    effect : Effect
        With the parameters ``inverse_width`` and ``inverse_exponent``.
    rates : mapping of str to Signal
        u' of one or two coordinates, by names of their states.
    fastest : float
        Their largest.

    Returns
    -------
    h : Signal
        Of each coordinate; the length of the vector is 1 at most.
    drawn : Signal
        By how much u has drawn it along: h width/2.
    """
    drawn = [plant.state(f"drawn.{name}") for name in rates]
    h = [plant.port(effect.slot("inverse_width"), own, scale=2.0) for own in drawn]
    pairs = list(zip(rates.values(), h, strict=True))
    law = {"A": 1.0, "beta": 1.0, "gamma": 0.0, "coordinates": float(len(pairs))}
    constants = law | {"rate_smoothing": ROUNDED_RATE * fastest, "state_smoothing": ROUNDED_STATE}
    for k, name in enumerate(rates):
        seen = [signal for pair in (pairs[k], *pairs[:k], *pairs[k + 1 :]) for signal in pair]
        moves = plant.block("bouc_wen", seen, {"inverse_n": effect.slot("inverse_exponent")}, constants)
        plant.set_rate(f"drawn.{name}", moves - CREEP * drawn[k])
    return list(zip(h, drawn, strict=True))
