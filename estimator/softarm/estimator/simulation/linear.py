"""The arm linearised along a drive: cheap enough to try hundreds of hypotheses."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.rotations import exp
from softarm.estimator.simulation.drive import Drive
from softarm.estimator.simulation.segments import Segments


@dataclass(frozen=True)
class LinearisedArm:
    """The response to a baseline drive, and its first-order change; an ``Arm``."""

    segments: Segments
    drive: Drive
    baseline: ArmResponse

    def at(self, chosen: Flags | Indices) -> "LinearisedArm":
        """Select samples by flags or numbers."""
        return LinearisedArm(self.segments, self.drive.at(chosen), self.baseline.at(chosen))

    def twists(self, drive: Drive) -> Floats:
        """Return the sections' twists, shape (samples, 6 sections), by the change from the baseline drive."""
        return self.rigid(drive) + self._elastic(drive)

    def respond(
        self,
        drive: Drive,
        near: ArmResponse | None = None,  # noqa: ARG002
        *,
        jacobians: bool = True,  # noqa: ARG002
    ) -> ArmResponse:
        """Compute the response to a drive to first order."""
        elastic = self._elastic(drive)
        parts = (elastic + self.rigid(drive)).reshape(drive.samples, -1, 6)
        frames = Frames(
            self.baseline.frames.positions + parts[..., :3],
            exp(parts[..., 3:]) @ self.baseline.frames.rotations,
        )
        strains = self.baseline.strains + np.einsum("tgij,tj->tgi", self._rows, elastic)
        return replace(self.baseline, frames=frames, strains=strains)

    @cached_property
    def _rows(self) -> Floats:
        """Derivative of the strains by the twists, shape (samples, segments, 4, 6 sections)."""
        return self.segments.rows(self.baseline.frames)

    def _elastic(self, drive: Drive) -> Floats:
        """Return the twists by deformation; a rotated base rotates gravity and wrenches the other way."""
        base, response = self.drive, self.baseline
        # Parts of the drive that are those of the baseline change nothing, and most calls change one part.
        wrenches: Floats = (drive.wrenches - base.wrenches).reshape(base.samples, -1)
        gravity = drive.gravity - base.gravity
        if drive.base_rotation is not base.base_rotation:
            tilt = drive.base_rotation - base.base_rotation
            standing = base.wrenches.reshape(base.samples, -1, 3)
            wrenches = wrenches - np.cross(tilt[:, None], standing).reshape(wrenches.shape)
            gravity = gravity - np.cross(tilt, base.gravity)
        if drive.couples is not base.couples:
            wrenches = wrenches + np.einsum("tgij,tgi->tj", self._rows, drive.couples - base.couples)
        change = np.concatenate([drive.pressures - base.pressures, wrenches, gravity], axis=1)
        twists: Floats = np.einsum("tri,ti->tr", response.input_jacobian, change)
        if drive.eigenstrains is not base.eigenstrains:
            eigenstrains = (drive.eigenstrains - base.eigenstrains).reshape(base.samples, -1)
            twists = twists + np.einsum("tri,ti->tr", response.eigenstrain_jacobian, eigenstrains)
        return twists

    def rigid(self, drive: Drive) -> Floats:
        """Return the twists by the rotation of the base about the origin."""
        places = self.baseline.frames.positions
        if drive.base_rotation is self.drive.base_rotation:
            return np.zeros((len(places), 6 * places.shape[1]))
        tilt = np.broadcast_to((drive.base_rotation - self.drive.base_rotation)[:, None], places.shape)
        rigid: Floats = np.concatenate([np.cross(tilt, places), tilt], axis=-1)
        return rigid.reshape(len(places), -1)
