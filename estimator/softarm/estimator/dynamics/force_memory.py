"""What an arm remembers of the largest force on it, removed from the forces that follow.

A calibration rests on forces that rise. In rubber with hysteresis, unloading leaves the curve of first
loading by what grows with the way back (G. Masing, Proc. 2nd Int. Congr. Appl. Mech. 1926, for elastic-slip
elements). An estimate without history treats the arm, which is still bent, as one that is held: with F the
largest force so far, u its direction and m the share that is remembered, it estimates a force f as

    f + m u (|F| - u . f).

A tare begins a new history: forces count from there, and what is remembered of those before stays removed.
Under pressure there is none: the arm is strained by more than forces.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Load
from softarm.estimator.specimen import Value


class ForceMemory:
    """Follow the largest force on each section.

    Args:
        loads: The unknown loads.
        shares: m of each section, by its name; sections that it lacks remember nothing.
    """

    def __init__(self, loads: Sequence[Load], shares: Mapping[str, Value]) -> None:
        places = [load.section if load.kind == "force" else None for load in loads]
        self._groups = [
            (np.array([k for k, place in enumerate(places) if place == name]), share)
            for name, share in shares.items()
            if name in places
        ]
        self._largest, self._taken_out = np.zeros(len(loads)), np.zeros(len(loads))
        self._before_tare = np.zeros(len(loads))

    def reset(self) -> None:
        """Forget the past."""
        for array in (self._largest, self._taken_out, self._before_tare):
            array[:] = 0.0

    def tare(self) -> None:
        """Begin a new history at the last instant."""
        self._before_tare += self._taken_out
        for array in (self._largest, self._taken_out):
            array[:] = 0.0

    def update(self, forces: Floats, *, pressurised: bool = False) -> tuple[Floats, Floats]:
        """Return the forces without what is remembered, and the covariance of that.

        Args:
            forces: Amplitudes of the loads at the next instant, shape (loads,).
            pressurised: Whether pressures strain the arm, so that its history is not that of the forces.

        Returns:
            Shapes (loads,) and (loads, loads).
        """
        since, covariance = forces - self._before_tare, np.zeros((len(forces), len(forces)))
        self._taken_out[:] = 0.0
        if pressurised:
            self._largest[:] = 0.0
            return since, covariance
        for members, share in self._groups:
            now, largest = since[members], self._largest[members]
            size = float(np.linalg.norm(largest))
            if not np.isfinite(now).all():
                continue
            if np.linalg.norm(now) >= size:
                self._largest[members] = now
                continue
            along = largest / size
            back = (size - float(along @ now)) / (1.0 - share.value)
            self._taken_out[members] = share.value * back * along
            covariance[np.ix_(members, members)] = (share.std * back) ** 2 * np.outer(along, along)
        return since - self._taken_out, covariance
