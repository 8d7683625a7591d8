"""Manoeuvres that separate physical effects, and the choice among them."""

from softarm.estimator.excitation.manoeuvre import Manoeuvre, ManoeuvreLimits
from softarm.estimator.excitation.plan import ChosenManoeuvre, EffectPair, ExcitationPlan, full_plan, plan_for
from softarm.estimator.excitation.separation import SeparatedArm
from softarm.estimator.excitation.standard_manoeuvres import standard_manoeuvres

__all__ = [
    "ChosenManoeuvre",
    "EffectPair",
    "ExcitationPlan",
    "Manoeuvre",
    "ManoeuvreLimits",
    "SeparatedArm",
    "full_plan",
    "plan_for",
    "standard_manoeuvres",
]
