"""What an arm remembers of the largest force on it, as a deviation of the forces that follow.

A calibration rests on forces that rise. In rubber with hysteresis, unloading from F to f leaves the curve of
first loading by what grows with F - f and is largest at f = 0 (G. Masing, Proc. 2nd Int. Congr. Appl.
Mech. 1926, for elastic-slip elements): an
estimate that knows no history errs there by m (F - f), m the share of a force that is remembered.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Load


class RememberedForces:
    """Follow the largest force on each section.

    Args:
        loads: The unknown loads.
        shares: m of each section, by its name; sections that it lacks remember nothing.
    """

    def __init__(self, loads: Sequence[Load], shares: Mapping[str, float]) -> None:
        places = [load.section if load.kind == "force" else None for load in loads]
        self._groups = [
            (np.array([k for k, place in enumerate(places) if place == name]), share)
            for name, share in shares.items()
            if name in places
        ]
        self._largest = np.zeros(len(loads))

    def reset(self) -> None:
        """Forget the past."""
        self._largest[:] = 0.0

    def update(self, forces: Floats) -> Floats:
        """Return the covariance of what is remembered at the next instant, shape (loads, loads).

        Args:
            forces: Amplitudes of the loads at that instant, shape (loads,).
        """
        covariance = np.zeros((len(forces), len(forces)))
        for members, share in self._groups:
            now = forces[members]
            if not np.isfinite(now).all():
                continue
            if np.linalg.norm(now) >= np.linalg.norm(self._largest[members]):
                self._largest[members] = now
            error = share * (self._largest[members] - now)
            covariance[np.ix_(members, members)] = np.outer(error, error)
        return covariance
