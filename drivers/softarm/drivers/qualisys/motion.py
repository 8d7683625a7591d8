"""What a motion-capture reading holds."""

from collections.abc import Mapping
from dataclasses import dataclass

from softarm.drivers.qualisys.poses import BodyPose


@dataclass(frozen=True, slots=True)
class MotionFrame:
    """All bodies of one frame.

    Args:
        poses: By name; None for a body that the cameras have lost.
        lost_for_s: By name, how long the lost ones have been so [s].
        drop_rate: Missing camera data of the last second [per mille].
        out_of_sync_rate: Late camera data of the last second [per mille].
    """

    poses: Mapping[str, BodyPose | None]
    lost_for_s: Mapping[str, float]
    drop_rate: int = 0
    out_of_sync_rate: int = 0
