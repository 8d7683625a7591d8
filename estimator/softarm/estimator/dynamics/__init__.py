"""Forces on an arm that moves."""

from softarm.estimator.dynamics.moving_forces import MovingForces

__all__ = ["MovingForces"]
