"""Compares the calibrated rod with the finite elements now and then, in parallel to the estimates."""

import os
import threading
from typing import Any

import numpy as np

from softarm.estimator.background import Background
from softarm.estimator.model import ArmModel, Frames, Inputs
from softarm.estimator.rotations import log

INTERVAL_S = 10.0
LAST = 19
"""Niceness of the comparison: it takes a tenth of a second and more, in which estimates are due."""


class RodCheck(Background[tuple[Inputs, Frames], float | None]):
    """Solves the finite elements for inputs at which the frames of the rod are known.

    Args:
        model: Finite elements with the loads of the rod, and pressures that act as on it.
        interval_s: Least time between two comparisons [s].
    """

    def __init__(self, model: ArmModel[Any, Any], interval_s: float = INTERVAL_S) -> None:
        super().__init__(self._compare, "rod check")
        self._model = model
        self._interval_s = interval_s
        self._state = model.rest()
        self._next_s = -np.inf

    @property
    def departure(self) -> float | None:
        """Largest angle between the sections of rod and finite elements when last compared [rad]."""
        return self.newest

    def offer(self, time_s: float, inputs: Inputs, frames: Frames) -> None:
        """Start a comparison of the rod's frames, unless one is at hand or was made a short while ago.

        Args:
            time_s: Time of the readings [s].
            inputs: Inputs of the rod.
            frames: Its frames.
        """
        if time_s >= self._next_s and self.idle:
            self._next_s = time_s + self._interval_s
            self.ask((inputs, frames))

    def _compare(self, sample: tuple[Inputs, Frames]) -> float | None:
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), LAST)  # of this thread alone (sched(7))
        inputs, frames = sample
        state, converged = self._model.solve(inputs, self._state)
        # The next comparison must not start from where a search went astray.
        if not converged:
            self._state = self._model.rest()
            return None
        self._state = state
        truth = self._model.linearise(state, inputs).frames
        rotations = log(np.swapaxes(truth.rotations, -1, -2) @ frames.rotations)
        return float(np.linalg.norm(rotations, axis=-1).max())
