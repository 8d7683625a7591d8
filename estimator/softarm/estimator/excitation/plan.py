"""Which manoeuvres to run: those that decide most per second among what is still ambiguous."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from softarm.estimator.effects.effect import describe
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.excitation.manoeuvre import Manoeuvre
from softarm.estimator.excitation.separation import SeparatedArm, SeparationTrial

DECISIVE_SEPARATION = 50.0
"""Separation D^2 from which two explanations are distinguished, with a margin of two on chance."""
OVERHEAD = 6.0
"""Time between two manoeuvres for venting and for the file [s]."""


@dataclass(frozen=True)
class EffectPair:
    """An explanation and one that the present data do not distinguish from it.

    Args:
        found: The explanation, as fitted.
        rival: The other; its parameters are where its fit begins.
    """

    found: PlacedEffect
    rival: PlacedEffect

    @property
    def name(self) -> str:
        """Both in words."""
        return f"{_name(self.found)} or {_name(self.rival)}"


def _name(placed: PlacedEffect) -> str:
    return f"{placed.effect.name} ({describe(placed.spot.place)})"


@dataclass(frozen=True)
class ChosenManoeuvre:
    """A manoeuvre and what is expected of it.

    Args:
        separations: D^2 of each pair.
    """

    manoeuvre: Manoeuvre
    separations: tuple[float, ...] = ()

    @property
    def seconds(self) -> float:
        """Its duration, venting included [s]."""
        return self.manoeuvre.duration + OVERHEAD

    def gain(self, lacking: Sequence[float]) -> float:
        """Return the useful separation per second, ``lacking`` what each pair still needs."""
        useful = sum(min(gain, lack) for gain, lack in zip(self.separations, lacking, strict=True))
        return useful / self.seconds


@dataclass(frozen=True)
class ExcitationPlan:
    """What to run, in this order.

    Args:
        choices: The manoeuvres.
        pairs: The pairs that it is to separate; none where everything is to be shown.
    """

    choices: tuple[ChosenManoeuvre, ...]
    pairs: tuple[EffectPair, ...] = ()

    @property
    def seconds(self) -> float:
        """Time of the whole [s]."""
        return sum(choice.seconds for choice in self.choices)

    def separation(self, pair: int) -> float:
        """Return the separation that the whole plan expects for a pair."""
        return sum(choice.separations[pair] for choice in self.choices)

    @property
    def undecided(self) -> tuple[EffectPair, ...]:
        """Pairs that the whole plan will not separate."""
        return tuple(p for k, p in enumerate(self.pairs) if self.separation(k) < DECISIVE_SEPARATION)


def full_plan(manoeuvres: Sequence[Manoeuvre]) -> ExcitationPlan:
    """Plan everything, in the order given."""
    return ExcitationPlan(tuple(ChosenManoeuvre(manoeuvre) for manoeuvre in manoeuvres))


def plan_for(
    pairs: Sequence[EffectPair],
    manoeuvres: Sequence[Manoeuvre],
    subject: SeparatedArm,
    advance: Callable[[float], None] = lambda _: None,
) -> ExcitationPlan:
    """Choose manoeuvres for pairs of effects, the one first that separates them most per second of run.

    ``advance`` is called with 1 after each pair on each manoeuvre.
    """
    remaining = []
    for manoeuvre in manoeuvres:
        trial = subject.trial(manoeuvre)
        remaining.append(
            ChosenManoeuvre(manoeuvre, tuple(_separation(trial, pair, advance) for pair in pairs))
        )
    lacking, chosen = [DECISIVE_SEPARATION] * len(pairs), []
    while remaining and any(lack > 0.0 for lack in lacking):
        best = max(remaining, key=lambda choice: choice.gain(lacking))
        # A D^2 below 1 decides nothing; what is left of the list would only take time.
        if best.gain(lacking) * best.seconds < 1.0:
            break
        remaining.remove(best)
        chosen.append(best)
        lacking = [max(0.0, a - b) for a, b in zip(lacking, best.separations, strict=True)]
    return ExcitationPlan(tuple(chosen), tuple(pairs))


def _separation(trial: SeparationTrial, pair: EffectPair, advance: Callable[[float], None]) -> float:
    value = trial.separation(pair.found, pair.rival)
    advance(1)
    return value
