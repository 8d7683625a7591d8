"""How loads change between two instants."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats


@dataclass(frozen=True)
class LoadProcess:
    """Loads that wander about zero (an Ornstein-Uhlenbeck process).

    Over dt, with a = exp(-dt / time_constant), mean' = a mean and covariance' = a^2 covariance +
    (1 - a^2) sigma^2. Over short times this is a random walk of variance 2 sigma^2 dt / time_constant; over
    long ones nothing is known but ``sigma``. A sensor that falls silent so widens the covariance without a
    jump.

    Args:
        sigma: Long-run standard deviation of each load [N or N m], shape (loads,).
        time_constant: [s]; 0 makes every instant independent of the last.
    """

    sigma: Floats
    time_constant: float

    def start(self) -> tuple[Floats, Floats]:
        """Return mean and covariance where nothing has been seen yet."""
        return np.zeros(len(self.sigma)), np.diag(self.sigma**2)

    def predict(self, mean: Floats, covariance: Floats, duration: float) -> tuple[Floats, Floats]:
        """Carry mean, shape (loads,), and covariance, shape (loads, loads), over a duration [s]."""
        kept = np.exp(-max(duration, 0.0) / self.time_constant) if self.time_constant > 0 else 0.0
        return kept * mean, kept**2 * covariance + (1.0 - kept**2) * np.diag(self.sigma**2)
