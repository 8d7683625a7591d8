"""Estimation with a model that contains accepted physics."""

from softarm.estimator.augmented.estimator import AugmentedEstimator, TrackingEstimator, estimator_of
from softarm.estimator.augmented.model import AugmentedModel, LoadDistribution

__all__ = ["AugmentedEstimator", "AugmentedModel", "LoadDistribution", "TrackingEstimator", "estimator_of"]
