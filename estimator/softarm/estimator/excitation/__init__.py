"""Manoeuvres that separate physical effects, and the choice among them."""

from softarm.estimator.excitation.manoeuvre import Manoeuvre, ManoeuvreLimits
from softarm.estimator.excitation.menu import menu
from softarm.estimator.excitation.plan import ChosenManoeuvre, ExcitationPlan, Rivals, plan_for, whole
from softarm.estimator.excitation.separation import SeparatedArm

__all__ = [
    "ChosenManoeuvre",
    "ExcitationPlan",
    "Manoeuvre",
    "ManoeuvreLimits",
    "Rivals",
    "SeparatedArm",
    "menu",
    "plan_for",
    "whole",
]
