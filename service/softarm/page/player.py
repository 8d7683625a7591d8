"""The time of a page that shows the past: a slider with marks, which plays in real time."""

import threading
import time
from collections.abc import Callable, Iterable

import numpy as np
import viser

REFRESH_S = 0.1
STEP_S = 0.01
MARKS = 100
"""Number of places on the slider that the eye can distinguish."""


class Player:
    """A slider over the time of a recording; live within the block.

    Args:
        gui: viser's widgets.
        span_s: First and last time [s].
        show: Shows everything at a time [s]; it is called from one thread.
        marked_s: Times to mark on the slider [s].
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        span_s: tuple[float, float],
        show: Callable[[float], None],
        marked_s: Iterable[float] = (),
    ) -> None:
        begin, end = _in_steps(*span_s)
        self._show = show
        self._slider = gui.add_slider(
            "Time [s]", begin, end, STEP_S, begin, marks=marks(marked_s, begin, end) or None
        )
        play = gui.add_button("Play / pause", hint="Play in real time; at the end, from the beginning.")
        play.on_click(lambda _: self._play_or_pause())
        self._shown_s: float | None = None
        self._playing_since: tuple[float, float] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="softarm-player", daemon=True)

    def __enter__(self) -> "Player":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def begin_anew(self, span_s: tuple[float, float]) -> None:
        """Go to the beginning of another recording, from its first to its last time [s]."""
        self._playing_since = None
        self._slider.min, self._slider.max = _in_steps(*span_s)
        self._slider.value = self._slider.min  # type: ignore[misc]  # mypy does not find viser's setter
        self.show_again()

    def show_again(self) -> None:
        """Show the time of the slider once more, although it has not moved."""
        self._shown_s = None

    def _play_or_pause(self) -> None:
        """Play from the slider's time on, or stop there."""
        if self._playing_since is not None:
            self._playing_since = None
            return
        begin_s = self._slider.min if self._slider.value >= self._slider.max else self._slider.value
        self._playing_since = time.monotonic(), begin_s

    def _follow(self) -> None:
        """Show the time of the slider, and move it while the recording plays."""
        while True:
            playing, moved = self._playing_since, self._slider.value != self._shown_s
            if playing is not None and moved:  # moved by hand
                self._playing_since = playing = time.monotonic(), self._slider.value
            if playing is not None:
                self._advance(*playing)
            if self._slider.value != self._shown_s:
                self._shown_s = self._slider.value
                self._show(self._shown_s)
            if self._closing.wait(REFRESH_S):
                return

    def _advance(self, since_s: float, begin_s: float) -> None:
        at_s = min(round(begin_s + time.monotonic() - since_s, 2), self._slider.max)
        if at_s >= self._slider.max:  # whoever sees the end may play again
            self._playing_since = None
        self._slider.value = at_s  # type: ignore[misc]  # mypy does not find viser's setter


def marks(times_s: Iterable[float], begin_s: float, end_s: float) -> tuple[float, ...]:
    """Return where a slider is marked [s]: times that the eye cannot distinguish share a mark."""
    grain = (end_s - begin_s) / MARKS
    inside = np.array([time_s for time_s in times_s if begin_s <= time_s <= end_s])
    _, first = np.unique(np.round((inside - begin_s) / grain), return_index=True)
    return tuple(inside[first].tolist())


def _in_steps(first_s: float, last_s: float) -> tuple[float, float]:
    """Return the ends of the slider, in its steps."""
    begin = round(float(first_s), 2)
    return begin, max(round(float(last_s), 2), begin + STEP_S)
