"""Holds the calibrated rod against the finite elements now and then, beside the estimates."""

from threading import Condition, Thread
from types import TracebackType
from typing import Any

import numpy as np

from estimator.model import ArmModel, Frames, Inputs
from estimator.rotations import log

INTERVAL_S = 10.0


class RodCheck:
    """Owns one thread that solves the finite elements for inputs at which the rod has given frames.

    Use it as a context manager.

    Args:
        model: Finite elements with the loads of the rod, and pressures that act as on it.
        interval_s: Least time between two comparisons [s].
    """

    def __init__(self, model: ArmModel[Any, Any], interval_s: float = INTERVAL_S) -> None:
        self._model = model
        self._interval_s = interval_s
        self._state = model.rest()
        self._changed = Condition()
        self._request: tuple[Inputs, Frames] | None = None
        self._departure: float | None = None
        self._next_s = -np.inf
        self._busy = self._closing = False
        self._thread = Thread(target=self._run, name="rod check", daemon=True)

    def __enter__(self) -> "RodCheck":
        """Start the thread."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the thread finish what it has in hand, and end it."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    @property
    def departure(self) -> float | None:
        """Largest angle between the sections of rod and finite elements when last compared [rad]."""
        with self._changed:
            return self._departure

    def offer(self, time_s: float, inputs: Inputs, frames: Frames) -> None:
        """Have the rod's frames compared, unless a comparison is at hand or was made a short while ago.

        Args:
            time_s: Time of the readings [s].
            inputs: Inputs of the rod.
            frames: Its frames.
        """
        with self._changed:
            if self._busy or time_s < self._next_s:
                return
            self._next_s = time_s + self._interval_s
            self._request, self._busy = (inputs, frames), True
            self._changed.notify_all()

    def wait(self) -> None:
        """Wait until no comparison is at hand."""
        with self._changed:
            self._changed.wait_for(lambda: self._closing or not self._busy)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._request is not None)
                if self._closing or self._request is None:
                    return
                (inputs, frames), self._request = self._request, None
            departure = self._compare(inputs, frames)
            with self._changed:
                self._departure, self._busy = departure, False
                self._changed.notify_all()

    def _compare(self, inputs: Inputs, frames: Frames) -> float | None:
        state, found = self._model.solve(inputs, self._state)
        if not found:
            self._state = self._model.rest()
            return None
        self._state = state
        truth = self._model.linearise(state, inputs).frames
        turned = log(np.swapaxes(truth.rotations, -1, -2) @ frames.rotations)
        return float(np.linalg.norm(turned, axis=-1).max())
