"""Check time stamps and frame numbers for lost frames, a new measurement and a frozen picture."""

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

    A live preview may number all its frames 1, so a repeated frame number means nothing; a repeated time
    stamp does.

    Args:
        stride: Frame numbers from one frame to the next, as asked for.
    """

    def __init__(self, stride: int = 1) -> None:
        self._stride = stride
        self._last: tuple[int, int] | None = None

    def step(self, timestamp_us: int, frame: int) -> FrameStep:
        """Compare time stamp [us] and number of a frame with those of the last one."""
        last, self._last = self._last, (timestamp_us, frame)
        if last is None:
            return FrameStep()
        if timestamp_us < last[0] or frame < last[1]:
            return FrameStep(restarted=True)
        if timestamp_us == last[0]:
            return FrameStep(frozen=True)
        return FrameStep(lost=max(0, (frame - last[1]) // self._stride - 1))
