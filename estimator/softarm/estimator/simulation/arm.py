"""The arm's quasi-static answer to a drive, by any model of ``softarm.estimator.model``."""

from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.errors import InputError
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.rotations import exp
from softarm.estimator.simulation.compliance import stiffness_along, yielding
from softarm.estimator.simulation.drive import Drive, Response
from softarm.estimator.simulation.segments import Segments

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
GRAVITY_STEP = 0.5  # m/s2, of the difference that gives the derivative by gravity


class Arm(Protocol):
    """Whatever answers a drive: the model itself or its linearisation along a drive."""

    @property
    def segments(self) -> Segments:
        """The segments."""

    def respond(self, drive: Drive, near: Response | None = None, *, slopes: bool = True) -> Response:
        """Answer a drive.

        Args:
            drive: What acts.
            near: A response close by, in whose pose the couples act and from which the search begins.
            slopes: Whether the derivatives are wanted.
        """


class BatchAnswer(Protocol):
    """Answers of a model to many samples, as ``softarm.estimator.rod.model.Batch``."""

    @property
    def frames(self) -> Frames:
        """Frames with a leading axis (samples,)."""

    @property
    def motion(self) -> Floats:
        """Twists by pressures, loads, gravity and more, shape (samples, 6 sections, inputs)."""

    @property
    def converged(self) -> Flags:
        """Shape (samples,)."""


class BatchModel(Protocol):
    """A model that solves many samples in one call."""

    def evaluate(self, pressures: Floats, loads: Floats, gravity: Floats) -> BatchAnswer:
        """Solve samples with pressures, load amplitudes and gravity of shape (samples, ...)."""


class StrainedAnswer(BatchAnswer, Protocol):
    """Answers of a model whose regions strain freely, as ``softarm.estimator.rod.model.Batch``."""

    @property
    def by_free(self) -> Floats:
        """Twists per unit of the regions' free strains, shape (samples, 6 sections, regions, 4)."""

    @property
    def states(self) -> Floats:
        """States of the model, shape (samples, ...)."""


@runtime_checkable
class StrainedModel(Protocol):
    """A model that solves many samples in one call, with regions that strain freely."""

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the regions."""

    @property
    def factors(self) -> Floats:
        """Stiffness factor of each region, shape (regions,)."""

    def evaluate(
        self,
        pressures: Floats,
        loads: Floats,
        gravity: Floats,
        free: Floats,
        *,
        start: Floats | None,
        slopes: bool,
    ) -> StrainedAnswer:
        """Solve samples, begun from states; ``free`` of shape (samples, regions, 4)."""


def section_loads(sections: tuple[str, ...]) -> tuple[Load, ...]:
    """List unit forces, then moments, along the base axes on each section: the wrenches of a drive."""
    return tuple(
        Load(f"{section}_{kind}_{letter}", "force" if kind == "force" else "moment", axis, section)
        for section in sections
        for kind in ("force", "moment")
        for letter, axis in zip("xyz", AXES, strict=True)
    )


@dataclass(frozen=True)
class SimulatedArm(Generic[State, Step]):
    """A model whose loads are ``section_loads(model.sections)``, with the segments between its sections.

    Args:
        model: Model of the arm.
        segments: Its segments.

    Raises:
        InputError: If the model's loads are others.
    """

    model: ArmModel[State, Step]
    segments: Segments

    def __post_init__(self) -> None:
        wanted = section_loads(self.model.sections)
        if tuple((a.kind, a.direction, a.section) for a in self.model.loads) != tuple(
            (b.kind, b.direction, b.section) for b in wanted
        ):
            raise InputError("loads", "not the sections' wrenches", "build the model with section_loads()")

    def respond(self, drive: Drive, near: Response | None = None, *, slopes: bool = True) -> Response:
        """Answer a drive, each sample begun from the one before, or from the states nearby; see ``Arm``.

        A turned base turns gravity and the wrenches into its frame, and the frames out of it.
        """
        turn = exp(drive.base_rotation)
        wrenches = drive.wrenches + self._coupled(drive, near)
        local = np.einsum("tji,tskj->tski", turn, wrenches.reshape(*wrenches.shape[:2], 2, 3))
        local = local.reshape(drive.samples, -1)
        gravity = np.einsum("tji,tj->ti", turn, drive.gravity)
        if isinstance(self.model, StrainedModel):
            start = near.states if near is not None else None
            return _turned_out(self._strained(self.model, drive, local, gravity, start, slopes), turn)
        answer = self._evaluate(drive.pressures, local, gravity)
        motion = answer.motion[..., : drive.pressures.shape[1] + local.shape[1] + 3]
        strains = self.segments.strains(answer.frames)
        plain = Response(answer.frames, strains, motion, motion[..., :0], answer.converged)
        response = _turned_out(plain, turn)
        by_free = yielding(self.segments, response.frames, response.by_wrench)
        return replace(response, by_free=by_free)

    def _coupled(self, drive: Drive, near: Response | None) -> Floats:
        """Give the sections' wrenches by couples, and by free strains where the model has none itself."""
        strained = not isinstance(self.model, StrainedModel) and bool(np.any(drive.free))
        if not np.any(drive.couples) and not strained:
            return np.zeros_like(drive.wrenches)
        plain = replace(drive, couples=np.zeros_like(drive.couples), free=np.zeros_like(drive.free))
        known = near or self.respond(plain)
        couples = drive.couples
        if strained:
            stiffness = stiffness_along(self.segments, known.frames, known.by_wrench)
            couples = couples + np.einsum("tgij,tgj->tgi", stiffness, drive.free)
        return self.segments.wrenches(known.frames, couples)

    def _strained(
        self,
        model: StrainedModel,
        drive: Drive,
        loads: Floats,
        gravity: Floats,
        start: Floats | None,
        slopes: bool,
    ) -> Response:
        """Solve a model that strains freely, in the frame of its base."""
        own = [model.regions.index(name) for name in self.segments.names]
        free = np.zeros((drive.samples, len(model.regions), 4))
        free[:, own] = drive.free
        answer = model.evaluate(drive.pressures, loads, gravity, free, start=start, slopes=slopes)
        strains = self.segments.strains(answer.frames)
        none = answer.motion[..., :0]
        if not slopes:
            return Response(answer.frames, strains, none, none, answer.converged, None, answer.states)
        inputs = answer.motion.shape[-1] - len(model.regions)
        by_free = answer.by_free[:, :, own].reshape(*answer.by_free.shape[:2], -1)
        by_stiffness = (answer.motion[..., inputs:] * model.factors)[..., own]
        motion = answer.motion[..., :inputs]
        return Response(
            answer.frames, strains, motion, by_free, answer.converged, by_stiffness, answer.states
        )

    def _evaluate(self, pressures: Floats, loads: Floats, gravity: Floats) -> BatchAnswer:
        evaluate = getattr(self.model, "evaluate", None)
        if evaluate is not None:
            answer: BatchAnswer = evaluate(pressures, loads, gravity)
            return answer
        return _one_by_one(self.model, pressures, loads, gravity)

    def stiffness(self) -> Floats:
        """Give each segment's stiffness against its own couples at rest, shape (segments, 4)."""
        model = self.model
        inputs = Inputs(np.zeros(model.chambers), np.zeros(len(model.loads)), np.zeros(3))
        step = model.linearise(model.rest(), inputs)
        rows = self.segments.rows(step.frames).reshape(4 * self.segments.count, -1)
        _, by_inputs = step.response(rows)
        compliance = np.diag(by_inputs[:, model.chambers :] @ rows.T)
        stiffness: Floats = (1.0 / compliance).reshape(-1, 4)
        return stiffness


def _turned_out(response: Response, turn: Floats) -> Response:
    """Express a response, and the wrenches and gravity that differentiate it, in the unturned frame."""
    frames = Frames(
        np.einsum("tij,tsj->tsi", turn, response.frames.positions),
        np.einsum("tij,tsjk->tsik", turn, response.frames.rotations),
    )
    motion = _out(response.motion, turn)
    samples, rows, inputs = motion.shape
    if inputs:
        chambers = inputs - rows - 3
        vectors = motion[..., chambers:].reshape(samples, rows, -1, 3)
        turned = np.einsum("tij,trkj->trki", turn, vectors).reshape(samples, rows, -1)
        motion = np.concatenate([motion[..., :chambers], turned], axis=-1)
    stiffness = response.by_stiffness
    return replace(
        response,
        frames=frames,
        motion=motion,
        by_free=_out(response.by_free, turn),
        by_stiffness=None if stiffness is None else _out(stiffness, turn),
    )


def _out(twists: Floats, turn: Floats) -> Floats:
    """Express twists, shape (samples, rows, columns), in the unturned frame."""
    samples, rows, columns = twists.shape
    out = np.einsum("tij,tnjk->tnik", turn, twists.reshape(samples, rows // 3, 3, columns))
    return np.asarray(out.reshape(samples, rows, columns), dtype=np.float64)


@dataclass(frozen=True)
class Answers:
    """Answers for many samples; see ``BatchAnswer``."""

    frames: Frames
    motion: Floats
    converged: Flags


def linear_motion(model: ArmModel[State, Step], state: State, inputs: Inputs) -> tuple[Frames, Floats]:
    """Give the frames at an equilibrium and the section twists per unit of each input.

    The derivative by gravity comes from differences.

    Returns:
        The frames, and the twists by pressures, loads and gravity, shape (6 sections, inputs + 3).
    """
    eye = np.eye(6 * len(model.sections))
    step = model.linearise(state, inputs)
    drift, by_inputs = step.response(eye)
    by_gravity = []
    for axis in np.eye(3):
        nearby = model.linearise(state, replace(inputs, gravity=inputs.gravity + GRAVITY_STEP * axis))
        by_gravity.append((nearby.response(eye)[0] - drift) / GRAVITY_STEP)
    return step.frames, np.column_stack([by_inputs, *by_gravity])


def _one_by_one(
    model: ArmModel[State, Step], pressures: Floats, loads: Floats, gravity: Floats
) -> BatchAnswer:
    """Solve samples one after the other; the derivative by gravity comes from differences."""
    state = model.rest()
    places, turns, motions, found = [], [], [], []
    for p, amplitude, g in zip(pressures, loads, gravity, strict=True):
        state, good = model.solve(Inputs(p, amplitude, g), state)
        frames, motion = linear_motion(model, state, Inputs(p, amplitude, g))
        motions.append(motion)
        places.append(frames.positions)
        turns.append(frames.rotations)
        found.append(good)
    return Answers(Frames(np.array(places), np.array(turns)), np.array(motions), np.array(found))
