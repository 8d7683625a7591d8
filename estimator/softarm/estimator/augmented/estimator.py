"""The tracking estimator on a model that contains accepted physics.

At each instant the effects change the pressures and gravity, load the sections and rotate the base as the
last estimate determines, and the effects of sensors are removed from the readings. The estimator solves the
remaining problem.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.augmented.model import AugmentedModel, AugmentedStep, LoadDistribution
from softarm.estimator.effects.accepted import accepted_physics
from softarm.estimator.effects.effect import Memory
from softarm.estimator.effects.placed import PlacedEffect, signals_of
from softarm.estimator.effects.readings import QUATERNION, has_orientation
from softarm.estimator.effects.simulate import (
    advance_with,
    recorded_rotation,
    simulate_with,
    standing_pressures,
)
from softarm.estimator.effects.world import World
from softarm.estimator.inverse import ArmEstimate, Estimator, TrackerSettings
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.response import ArmResponse
from softarm.estimator.rotations import exp, from_quaternions, to_quaternions
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.simulation import Drive, RespondingArm, Segments, SimulatedArm
from softarm.estimator.simulation.compliance import bounded_inverse
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch import stretched

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

INVERSION_PASSES = 8
"""Passes of the search for the pressures behind those that act: enough where an effect halves them."""
REGISTRATION_SAMPLES = 20
"""Samples of a recording from which the mean rotation of its base is computed."""


class TrackingEstimator(Protocol[State]):
    """What follows an arm through time: the plain estimator or the one with physics."""

    def reset(self) -> None:
        """Forget the past."""

    @property
    def model(self) -> Any:
        """The model it runs on, with the unknown loads."""

    def suite_at(self, pressures: Floats) -> SensorSuite:
        """Return the sensors, as noisy as they and the model are together at measured pressures [Pa]."""

    def update(self, time: float, readings: Floats, pressures: Floats, gravity: Floats) -> ArmEstimate[State]:
        """Estimate at an instant; see ``softarm.estimator.inverse.Estimator.update``."""


def estimator_of(
    specimen: Specimen,
    model: ArmModel[State, Step],
    loads: Sequence[Load],
    suite: SensorSuite,
    settings: TrackerSettings,
    *,
    pressures_measured: bool,
    fast_model: ArmModel[Any, Any] | None = None,
    recorded: tuple[Floats, Floats] | None = None,
) -> TrackingEstimator[State]:
    """Make the estimator of a specimen, with its physics where it has any.

    Args:
        specimen: The robot.
        model: Its model, with ``section_loads(model.sections)`` where it has physics, else ``loads``.
        loads: The unknown loads.
        suite: The sensors.
        settings: What the estimator assumes.
        pressures_measured: Whether pressures are readings at the arm, not set-points.
        fast_model: A fast model with ``loads``, at whose answer the search starts where there are no physics.
        recorded: Times [s], shape (samples,), and measured pressures [Pa], shape (samples, chambers), of the
            recording by whose base the sensors were registered, where they were.

    Raises:
        InputError: The model's loads are others, or an effect does not fit the arm.
    """
    if not specimen.physics:
        return Estimator(stretched(model, specimen), suite, settings, fast_model)
    start = Inputs(np.zeros(model.chambers), np.zeros(len(model.loads)), np.zeros(3))
    rest = model.linearise(model.rest(), start).frames
    segments = Segments.of(specimen, model.sections, rest)
    followed = stretched(model, specimen)
    arm = SimulatedArm(SequentialBatchModel(followed), segments)
    names = tuple(sensor.name for sensor in suite.measurements)
    stiffness, actuation = arm.stiffness(), settings.actuation
    world = World.of(specimen, segments, model.sections, stiffness, names, pressures_measured, actuation)
    effects = accepted_physics(specimen, world)
    if recorded is not None:
        time, pressures = _evenly_spread(*recorded)
        gravity = np.array(specimen.gravity_m_s2)
        acting = actuation.to_chamber(pressures)
        drive = Drive.of(time, acting, gravity, len(model.sections), segments.count)
        suite = registration_corrected(suite, arm, world, effects, drive)
    return AugmentedEstimator(followed, segments, tuple(loads), world, effects, suite, settings)


def registration_corrected(
    suite: SensorSuite, arm: RespondingArm, world: World, effects: Sequence[PlacedEffect], drive: Drive
) -> SensorSuite:
    """Register the laboratory by the base at rest, where the recorded base had rotated."""
    if not suite.base_recorded or all(placed.field != "base_rotation" for placed in effects):
        return suite
    rotations = simulate_with(effects, arm, world, drive).drive.base_rotation
    return suite.moved(np.concatenate([np.zeros(3), recorded_rotation(rotations, effects)]))


def _evenly_spread(time: Floats, pressures: Floats) -> tuple[Floats, Floats]:
    """Keep about ``REGISTRATION_SAMPLES`` samples with all pressures, evenly spread."""
    whole = np.flatnonzero(np.isfinite(pressures).all(axis=1))
    chosen = whole[
        np.unique(np.linspace(0, len(whole) - 1, min(REGISTRATION_SAMPLES, len(whole))).astype(int))
    ]
    return time[chosen], pressures[chosen]


class AugmentedEstimator(Generic[State, Step]):
    """Follows an arm whose model contains effects.

    Args:
        model: Model of the arm without them; its loads are the wrenches of its sections.
        loads: The unknown loads.
        world: What the effects refer to.
        suite: The sensors.
        settings: What the estimator assumes.
    """

    def __init__(
        self,
        model: ArmModel[State, Step],
        segments: Segments,
        loads: tuple[Load, ...],
        world: World,
        effects: tuple[PlacedEffect, ...],
        suite: SensorSuite,
        settings: TrackerSettings,
    ) -> None:
        self._arm_model, self._segments = model, segments
        self._world, self._effects = world, effects
        self._rest = world.stiffness
        self._suite, self._settings = suite, settings
        self._distribution = LoadDistribution(loads, model.sections)
        self._estimator: Estimator[State, AugmentedStep[State, Step]] = Estimator(
            self._augmented_model(np.zeros(6 * len(model.sections)), np.eye(3)), suite, settings
        )
        self.reset()

    def reset(self) -> None:
        """Forget the past, that of the effects included."""
        self._estimator.reset()
        self._memories: tuple[Memory, ...] = ((),) * len(self._effects)
        self._couples = np.zeros((1, self._segments.count, 4))
        self._world = replace(self._world, stiffness=self._rest)
        self._last: ArmResponse | None = None
        self._pull = np.zeros((1, len(self._arm_model.sections), 6))
        self._base_rotation = np.eye(3)

    def update(self, time: float, readings: Floats, pressures: Floats, gravity: Floats) -> ArmEstimate[State]:
        """Estimate at an instant; see ``softarm.estimator.inverse.Estimator.update``."""
        acting = self._settings.actuation.to_chamber(pressures)
        lost = ~np.isfinite(acting)
        drive = self._drive(time, np.where(lost, 0.0, acting), gravity)
        last = self._last or self._at_rest(drive)
        # Effects depend on the estimated pull, but the estimator receives only what they add to it.
        pulled = replace(drive, wrenches=self._pull)
        shaped, self._memories = advance_with(self._effects, self._world, pulled, last, self._memories)
        shaped = replace(shaped, wrenches=shaped.wrenches - self._pull)
        self._couples, self._base_rotation = shaped.couples, exp(shaped.base_rotation[0])
        inner = self._segments.wrenches(self._in_base_frame(last.frames), shaped.couples)
        self._estimator.follow(self._augmented_model((shaped.wrenches + inner).ravel(), self._base_rotation))
        measured = self._settings.actuation.to_measured(shaped.pressures[0])
        estimate = self._estimator.update(
            time,
            self._without_sensor_effects(readings, shaped, last),
            np.where(lost, np.nan, measured),
            shaped.gravity[0],
        )
        if np.isfinite(estimate.vector).all() and estimate.status != "diverged":
            self._last = self._response(estimate.frames)
            self._pull = (self._distribution.matrix @ estimate.inputs.loads).reshape(self._pull.shape)
            self._update_stiffness(shaped, estimate)
        return estimate

    def suite_at(self, pressures: Floats) -> SensorSuite:
        """Return the sensors, as noisy as they and the model are together at measured pressures [Pa]."""
        return self._estimator.suite_at(pressures)

    @property
    def model(self) -> ArmModel[State, AugmentedStep[State, Step]]:
        """The model under what the effects did at the last instant; its loads are the unknown ones."""
        return self._estimator.model

    def pressures_before_effects(self, pressures: Floats) -> Floats:
        """Return the pressures that the effects in the end change into given ones [Pa], shape (chambers,).

        They are as measured, but for the sensors' gains; none is below zero.
        """
        commanded = np.maximum(pressures, 0.0)
        for _ in range(INVERSION_PASSES):
            drive = self._drive(0.0, commanded, np.zeros(3))
            acting = standing_pressures(self._effects, self._world, drive)[0]
            commanded = np.maximum(commanded + pressures - acting, 0.0)
        return commanded

    def _update_stiffness(self, drive: Drive, estimate: ArmEstimate[State]) -> None:
        """Set the stiffness of the segments to that in an estimate's pose; the couples keep their strains."""
        if not any(placed.field == "eigenstrains" for placed in self._effects):
            return
        shaped = self._augmented_model(drive.wrenches.ravel(), self._base_rotation)
        step = self._arm_model.linearise(estimate.state, shaped.inner_inputs(estimate.inputs))
        rows = self._segments.rows(step.frames)
        _, motion = step.response(rows.reshape(-1, rows.shape[-1]))
        by_wrench = motion[:, self._arm_model.chambers :].reshape(rows.shape)
        compliance = np.einsum("gai,gbi->gab", by_wrench, rows)
        strains = self._world.strains(self._couples)
        self._world = replace(self._world, stiffness=bounded_inverse(compliance, self._rest)[None])
        self._couples = self._world.couples(strains)

    def _augmented_model(self, wrenches: Floats, base_rotation: Floats) -> AugmentedModel[State, Step]:
        return AugmentedModel(self._arm_model, self._distribution, wrenches, base_rotation)

    def _drive(self, time: float, acting: Floats, gravity: Floats) -> Drive:
        sections, segments = len(self._arm_model.sections), self._segments.count
        plain = Drive.of(np.array([time]), acting[None], gravity, sections, segments)
        return replace(plain, couples=self._couples)

    def _at_rest(self, drive: Drive) -> ArmResponse:
        """Return the response of the rested arm to the first drive."""
        model = self._arm_model
        inputs = Inputs(drive.pressures[0], np.zeros(len(model.loads)), drive.gravity[0])
        state, _ = model.solve(inputs, model.rest())
        return self._response(model.linearise(state, inputs).frames)

    def _in_base_frame(self, frames: Frames) -> Frames:
        """Transform frames into the rotated base's own frame."""
        base_rotation = self._base_rotation
        return Frames(frames.positions @ base_rotation, base_rotation.T @ frames.rotations)

    def _response(self, frames: Frames) -> ArmResponse:
        one = Frames(frames.positions[None], frames.rotations[None])
        strains = self._segments.strains(self._in_base_frame(one))
        return ArmResponse(one, np.ones(1, dtype=bool), strains=strains)

    def _without_sensor_effects(self, readings: Floats, drive: Drive, last: ArmResponse) -> Floats:
        """Remove the effects of the sensors from the readings, as far as the last estimate shows them."""
        sensing = [k for k, placed in enumerate(self._effects) if not placed.field]
        if not sensing:
            return readings
        clean, memories = readings.copy(), list(self._memories)
        for sensor in self._suite.measurements:
            part = self._suite.reading_slices[sensor.name]
            plain = sensor.predict(last.frames)
            for k in sensing:
                placed = self._effects[k]
                if placed.spot.place.sensor == sensor.name:
                    signals = signals_of(drive, self._world, last)
                    changed, memories[k] = placed.misread(signals, sensor, plain, self._memories[k])
                    lost = placed.effect.hides_reading
                    clean[part] = (
                        np.nan if lost else subtract_sensor_effect(clean[part], plain[0], changed[0])
                    )
        self._memories = tuple(memories)
        return clean


def subtract_sensor_effect(reading: Floats, plain: Floats, changed: Floats) -> Floats:
    """Subtract from a reading the change that an effect would make in the predicted one, shape (size,)."""
    if not has_orientation(reading):
        return reading - (changed - plain)
    measured, before, after = (from_quaternions(one[-QUATERNION:]) for one in (reading, plain, changed))
    place = reading[:-QUATERNION] - (changed - plain)[:-QUATERNION]
    return np.concatenate([place, to_quaternions(measured @ (before.T @ after).T)])
