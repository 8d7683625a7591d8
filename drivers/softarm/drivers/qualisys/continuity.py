"""What time stamps and frame numbers show: lost frames, a new measurement, a picture that stands still."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FrameStep:
    """One frame against the one before.

    Args:
        lost: Frames between the two that never came.
        restarted: The measurement has begun anew.
        frozen: Its time stamp is that of the frame before: nothing new was measured.
    """

    lost: int = 0
    restarted: bool = False
    frozen: bool = False


class Continuity:
    """Follows the frames of one connection.

    A live preview may number all its frames 1, so a frame number that stands still says nothing; a time stamp
    that stands still does.

    Args:
        stride: Frame numbers from one frame to the next, as asked for.
    """

    def __init__(self, stride: int = 1) -> None:
        self._stride = stride
        self._last: tuple[int, int] | None = None

    def step(self, timestamp_us: int, frame: int) -> FrameStep:
        """Take time stamp [us] and number of a frame."""
        last, self._last = self._last, (timestamp_us, frame)
        if last is None:
            return FrameStep()
        if timestamp_us < last[0] or frame < last[1]:
            return FrameStep(restarted=True)
        if timestamp_us == last[0]:
            return FrameStep(frozen=True)
        return FrameStep(lost=max(0, (frame - last[1]) // self._stride - 1))
