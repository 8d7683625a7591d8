"""Estimation with a model that contains accepted physics."""

from softarm.estimator.augmented.estimator import AugmentedEstimator, Follower, estimator_of
from softarm.estimator.augmented.model import ShapedModel, Spread

__all__ = ["AugmentedEstimator", "Follower", "ShapedModel", "Spread", "estimator_of"]
