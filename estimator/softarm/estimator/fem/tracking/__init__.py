"""Following an arm in real time: a factor that is reused, carried along and renewed in the background.

Only what follows an arm live imports this package; ``FiniteElementModel`` is the plain path and its
reference.
"""

from softarm.estimator.fem.tracking.model import BackgroundFactorisation, TrackingModel, TrackingState

__all__ = ["BackgroundFactorisation", "TrackingModel", "TrackingState"]
