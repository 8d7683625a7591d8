"""The arm's quasi-static answer to a drive, by any model of ``estimator.model``."""

from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from estimator.rotations import exp
from estimator.simulation.drive import Drive, Response
from estimator.simulation.segments import Segments

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

    def respond(self, drive: Drive, near: Response | None = None) -> Response:
        """Answer a drive; ``near`` is a response close by, in whose pose the couples act."""


class BatchAnswer(Protocol):
    """Answers of a model to many samples, as ``estimator.rod.model.Batch``."""

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

    def respond(self, drive: Drive, near: Response | None = None) -> Response:
        """Answer a drive, each sample begun from the one before; see ``Arm``.

        A turned base turns gravity and the wrenches into its frame, and the frames out of it.
        """
        turn = exp(drive.base_rotation)
        wrenches = drive.wrenches
        if np.any(drive.couples):
            known = near or self.respond(drive.plus(np.zeros_like(wrenches), -drive.couples))
            wrenches = wrenches + self.segments.wrenches(known.frames, drive.couples)
        local = np.einsum("tji,tskj->tski", turn, wrenches.reshape(*wrenches.shape[:2], 2, 3))
        gravity = np.einsum("tji,tj->ti", turn, drive.gravity)
        answer = self._evaluate(drive.pressures, local.reshape(drive.samples, -1), gravity)
        frames = Frames(
            np.einsum("tij,tsj->tsi", turn, answer.frames.positions),
            np.einsum("tij,tsjk->tsik", turn, answer.frames.rotations),
        )
        motion = _turned(answer.motion, turn, drive.pressures.shape[1])
        return Response(frames, self.segments.strains(answer.frames), motion, answer.converged)

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


def _turned(motion: Floats, turn: Floats, chambers: int) -> Floats:
    """Express twists, and the wrenches and gravity they are differentiated by, in the unturned frame."""
    samples, rows = motion.shape[:2]
    inputs = chambers + rows + 3
    out = np.einsum("tij,tnjk->tnik", turn, motion[..., :inputs].reshape(samples, -1, 3, inputs))
    out = out.reshape(samples, rows, inputs)
    vectors = out[..., chambers:].reshape(samples, rows, -1, 3)
    turned = np.einsum("tij,trkj->trki", turn, vectors).reshape(samples, rows, -1)
    return np.concatenate([out[..., :chambers], turned], axis=-1)


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
