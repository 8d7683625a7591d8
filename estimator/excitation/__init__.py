"""Manoeuvres that tell physical effects apart, and the choice among them."""

from estimator.excitation.manoeuvre import Limits, Manoeuvre
from estimator.excitation.menu import menu
from estimator.excitation.plan import Choice, Plan, Rivals, plan_for, whole
from estimator.excitation.separation import Subject, Trial

__all__ = ["Choice", "Limits", "Manoeuvre", "Plan", "Rivals", "Subject", "Trial", "menu", "plan_for", "whole"]
