"""Chambers whose effective pressure grows as they are stretched."""

from softarm.estimator.stretch.batch import StretchedBatch
from softarm.estimator.stretch.law import StretchLaw
from softarm.estimator.stretch.model import StretchedModel, stretched

__all__ = ["StretchLaw", "StretchedBatch", "StretchedModel", "stretched"]
