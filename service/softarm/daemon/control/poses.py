"""Saved poses: one JSON file, replaced as a whole."""

import json
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from softarm.daemon.estimation.messages import PoseTarget
from softarm.estimator.errors import InputError
from softarm.estimator.files import write_whole
from softarm_client.messages import SectionPose


class SavedPose(BaseModel):
    """A pose that was taught.

    Args:
        pressures_pa: Pressures that held it on the arm.
        sections: Section poses when it was saved; feedback leads back to them.
        reachable: Whether the arm could hold it within the sensors' noise when it was saved.
        note: What limits the arm there, in words.
        saved_unix_ns: Wall clock.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    pressures_pa: tuple[float, ...]
    sections: tuple[SectionPose, ...]
    saved_unix_ns: int
    reachable: bool = True
    note: str = ""

    @property
    def target(self) -> PoseTarget | None:
        """The pose for the feedback; ``None`` when no section was estimated."""
        if not self.sections:
            return None
        positions = np.array([section.position_m for section in self.sections])
        return PoseTarget(positions, np.array([section.quaternion_wxyz for section in self.sections]))


class PoseStore:
    """The poses of one arm.

    Args:
        path: The file; it is made with the first pose.

    Raises:
        InputError: The file is there and cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._poses = _read(path)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the poses, oldest first."""
        return tuple(self._poses)

    def get(self, name: str) -> SavedPose | None:
        """Return a pose by name."""
        return self._poses.get(name)

    def save(self, name: str, pose: SavedPose) -> None:
        """Remember a pose; one of the same name is replaced."""
        poses = {**self._poses, name: pose}
        document = {key: value.model_dump(mode="json") for key, value in poses.items()}
        write_whole({self._path: json.dumps(document, indent=1).encode()})
        self._poses = poses


def _read(path: Path) -> dict[str, SavedPose]:
    if not path.exists():
        return {}
    try:
        document = json.loads(path.read_text())
        return {name: SavedPose.model_validate(pose) for name, pose in document.items()}
    except (ValueError, ValidationError, AttributeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            str(path), f"not a list of poses ({reason})", "move the file away to start anew"
        ) from error
