"""Manoeuvres that tell physical effects apart, and the choice among them."""

from softarm.estimator.excitation.manoeuvre import Limits, Manoeuvre
from softarm.estimator.excitation.menu import menu
from softarm.estimator.excitation.plan import Choice, Plan, Rivals, plan_for, whole
from softarm.estimator.excitation.separation import Subject, Trial

__all__ = ["Choice", "Limits", "Manoeuvre", "Plan", "Rivals", "Subject", "Trial", "menu", "plan_for", "whole"]
