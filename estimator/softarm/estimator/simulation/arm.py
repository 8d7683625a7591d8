"""The arm's quasi-static response to a drive, by any model that solves many samples."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames, Load
from softarm.estimator.response import ArmResponse, BatchArmModel, BatchInputs
from softarm.estimator.rotations import exp
from softarm.estimator.simulation.compliance import stiffness_along, yielding
from softarm.estimator.simulation.drive import Drive
from softarm.estimator.simulation.segments import Segments

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class RespondingArm(Protocol):
    """Anything that responds to a drive: the model itself or its linearisation along a drive."""

    @property
    def segments(self) -> Segments:
        """The segments."""

    def respond(
        self, drive: Drive, near: ArmResponse | None = None, *, jacobians: bool = True
    ) -> ArmResponse:
        """Compute the response to a drive.

        Args:
            drive: What acts.
            near: A response close by, in whose pose the couples act and from which the search begins.
            jacobians: Whether the derivatives are wanted.
        """


def section_loads(sections: tuple[str, ...]) -> tuple[Load, ...]:
    """List unit forces, then moments, along the base axes on each section: the wrenches of a drive."""
    return tuple(
        Load(f"{section}_{kind}_{letter}", "force" if kind == "force" else "moment", axis, section)
        for section in sections
        for kind in ("force", "moment")
        for letter, axis in zip("xyz", AXES, strict=True)
    )


def with_segments(response: ArmResponse, model: BatchArmModel, segments: Segments) -> ArmResponse:
    """Add the strains of the segments to a model's response, and what their eigenstrains change.

    Args:
        response: The model's response, in the frame of its base.
        model: The model; its loads are ``section_loads`` where it has no eigenstrains among its inputs.
        segments: The segments between its sections.
    """
    response = replace(response, strains=segments.strains(response.frames))
    if not response.input_jacobian.shape[-1]:
        return response
    if model.takes_eigenstrains:
        indices = [model.regions.index(name) for name in segments.names]
        by_region = response.eigenstrain_jacobian
        columns = by_region.reshape(*by_region.shape[:2], -1, 4)[:, :, indices]
        return replace(response, eigenstrain_jacobian=columns.reshape(*by_region.shape[:2], -1))
    by_wrench = response.load_jacobian
    return replace(response, eigenstrain_jacobian=yielding(segments, response.frames, by_wrench))


@dataclass(frozen=True)
class SimulatedArm:
    """A model whose loads are ``section_loads(model.sections)``, with the segments between its sections.

    Raises:
        InputError: If the model's loads are others.
    """

    model: BatchArmModel
    segments: Segments

    def __post_init__(self) -> None:
        wanted = section_loads(self.model.sections)
        if tuple((a.kind, a.direction, a.section) for a in self.model.loads) != tuple(
            (b.kind, b.direction, b.section) for b in wanted
        ):
            raise InputError("loads", "not the sections' wrenches", "build the model with section_loads()")

    def respond(
        self, drive: Drive, near: ArmResponse | None = None, *, jacobians: bool = True
    ) -> ArmResponse:
        """Compute the response to a drive, begun from the states of a response nearby; see ``RespondingArm``.

        A rotated base rotates gravity and the wrenches into its frame, and the frames out of it.
        """
        rotation = exp(drive.base_rotation)
        wrenches = drive.wrenches + self._coupled(drive, near)
        local = np.einsum("tji,tskj->tski", rotation, wrenches.reshape(*wrenches.shape[:2], 2, 3))
        inputs = BatchInputs(
            drive.pressures,
            local.reshape(drive.samples, -1),
            np.einsum("tji,tj->ti", rotation, drive.gravity),
            self._by_region(drive) if self.model.takes_eigenstrains else None,
        )
        response = self.model.evaluate(
            inputs,
            start=near if near is not None and len(near.states) == drive.samples else None,
            jacobians=jacobians,
        )
        return _rotated(with_segments(response, self.model, self.segments), rotation)

    def stiffness(self) -> Floats:
        """Compute each segment's stiffness against its own couples at rest, shape (segments, 4)."""
        model = self.model
        rest = model.evaluate(BatchInputs.none(model))
        rows = self.segments.rows(rest.frames).reshape(4 * self.segments.count, -1)
        compliance = np.diag(rows @ rest.load_jacobian[0] @ rows.T)
        stiffness: Floats = (1.0 / compliance).reshape(-1, 4)
        return stiffness

    def _by_region(self, drive: Drive) -> Floats:
        """Order the segments' eigenstrains as the model's regions, shape (samples, regions, 4)."""
        eigenstrains = np.zeros((drive.samples, len(self.model.regions), 4))
        eigenstrains[:, [self.model.regions.index(name) for name in self.segments.names]] = drive.eigenstrains
        return eigenstrains

    def _coupled(self, drive: Drive, near: ArmResponse | None) -> Floats:
        """Return the sections' wrenches by couples, and by eigenstrains that are no input of the model."""
        strained = not self.model.takes_eigenstrains and bool(np.any(drive.eigenstrains))
        if not np.any(drive.couples) and not strained:
            return np.zeros_like(drive.wrenches)
        none = np.zeros_like(drive.couples)
        start = near or self.respond(replace(drive, couples=none, eigenstrains=none))
        couples = drive.couples
        if strained:
            stiffness = stiffness_along(self.segments, start.frames, start.load_jacobian)
            couples = couples + np.einsum("tgij,tgj->tgi", stiffness, drive.eigenstrains)
        return self.segments.wrenches(start.frames, couples)


def _rotated(response: ArmResponse, rotation: Floats) -> ArmResponse:
    """Express a response, and the wrenches and gravity that differentiate it, in the unrotated frame."""
    frames = Frames(
        np.einsum("tij,tsj->tsi", rotation, response.frames.positions),
        np.einsum("tij,tsjk->tsik", rotation, response.frames.rotations),
    )
    input_jacobian = _rotated_twists(response.input_jacobian, rotation)
    samples, rows, inputs = input_jacobian.shape
    if inputs:
        chambers = response.chambers
        vectors = input_jacobian[..., chambers:].reshape(samples, rows, -1, 3)
        rotated = np.einsum("tij,trkj->trki", rotation, vectors).reshape(samples, rows, -1)
        input_jacobian = np.concatenate([input_jacobian[..., :chambers], rotated], axis=-1)
    return replace(
        response,
        frames=frames,
        input_jacobian=input_jacobian,
        factor_jacobian=_rotated_twists(response.factor_jacobian, rotation),
        eigenstrain_jacobian=_rotated_twists(response.eigenstrain_jacobian, rotation),
    )


def _rotated_twists(twists: Floats, rotation: Floats) -> Floats:
    """Express twists, shape (samples, rows, columns), in the unrotated frame."""
    samples, rows, columns = twists.shape
    if not columns:
        return twists
    rotated = np.einsum("tij,tnjk->tnik", rotation, twists.reshape(samples, rows // 3, 3, columns))
    return np.asarray(rotated.reshape(samples, rows, columns), dtype=np.float64)
