"""Chambers whose pressure is worth more as they are stretched."""

from estimator.stretch.law import StretchLaw
from estimator.stretch.model import StretchedModel, stretched

__all__ = ["StretchLaw", "StretchedModel", "stretched"]
