"""A session on the calibrated model: the prediction, the residual, and what effects would change."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.unknowns import Prediction
from softarm.estimator.diagnosis.base_weight import BaseWeight
from softarm.estimator.diagnosis.equivalent_linearisation import BendVibration, EquivalentSegment, linearise
from softarm.estimator.diagnosis.exact_model import ExactModel
from softarm.estimator.diagnosis.recent import Recent
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.effects import Spot, World
from softarm.estimator.effects.effect import ModalChange, Signals
from softarm.estimator.effects.placed import PlacedEffect, met, signals_of
from softarm.estimator.effects.simulate import recorded_rotation, simulate_with
from softarm.estimator.model import Frames
from softarm.estimator.response import BatchArmModel
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.simulation import Drive, LinearisedArm, Segments, SimulatedArm
from softarm.estimator.simulation.compliance import stiffness_along
from softarm.estimator.simulation.inertia import VibratingArm, strain_stiffness
from softarm.estimator.specimen import Specimen

UNSTABLE = 1e6
"""Compliance over the usual one where no stable equilibrium is known: no fit minds such a sample."""
ELSEWHERE = 0.1
"""Difference between two answers of a model to the same drive [rad] from which they are two equilibria."""
SUDDEN, RINGDOWN = 0.2, 0.7
RINGING = 0.2
LEVER = 0.1
"""See ``Stage.model_error_std``: [s], [s], a share, [m]."""
KEPT, ACTIONS = 300, 30
"""Changes of the predictions that are kept of each session, some tens of kilobytes each, and actions on a
vibration, of a hundred kilobytes."""


@dataclass(frozen=True)
class Model:
    """The model of a specimen, to be calibrated and diagnosed.

    Args:
        specimen: The robot.
        model: Solves many samples; its loads are ``section_loads``.
        segments: The segments between its sections.
        fast: Whether it solves thousands of samples in seconds.
    """

    specimen: Specimen
    model: BatchArmModel
    segments: Segments
    fast: bool = False

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections whose frames it gives."""
        return self.model.sections

    def arm(self, setting: Setting) -> SimulatedArm:
        """Return the calibrated arm: stiffness, compliances and the worth of pressures under stretch."""
        return SimulatedArm(setting.model(self.model), self.segments)


@dataclass(frozen=True)
class Vibrations:
    """How the arm of a session vibrates, about its quasi-static strains and what effects change of them.

    Args:
        arm: The arm that vibrates.
        still: Quasi-static strains without effects, shape (samples, strains).
        resting: The arm linearised along the quasi-static poses.
    """

    arm: VibratingArm
    still: Floats
    resting: LinearisedArm

    def strains(self, change: Floats, other: VibratingArm | None = None) -> Floats:
        """Return what an effect changes of the strains while the arm vibrates, shape (samples, strains, ...).

        Args:
            change: What it changes of the quasi-static strains, shape (samples, strains, ...).
            other: The arm with the effect, if it vibrates in another way.
        """
        if other is None:
            return change + self.arm.lag(change)
        return change + other.lag(self.still + change) - self._usual_lag

    def rocked(
        self, arm: VibratingArm, change: Floats, rotation: Floats, modal: ModalChange, world: World
    ) -> tuple[Floats, Floats]:
        """Return what a compliant base and other effects change while the arm vibrates.

        Args:
            arm: The arm with the other effects.
            change: What these change of the quasi-static strains, shape (samples, strains).
            rotation: Of the base by the moment without it [rad], shape (samples, 3).
            modal: Compliance and damping of the base.
            world: The arm's masses.

        Returns:
            What changes of the strains, shape (samples, strains), and the rotation of the base [rad], shape
            (samples, 3).
        """
        compliance = modal.base_compliance
        resting = self.resting
        weight = BaseWeight.of(world, resting.drive, resting.baseline, self.strains_by_drive["gravity"])
        rested = weight.at_rest(rotation, compliance, self.arm.dynamics.stiffness)[:, :2]
        strained = self.still + change + _applied(weight.by_rotation, rested)
        still = np.concatenate([strained, rested], axis=1)
        held = arm.on_a_base(compliance, modal.base_damping_time, weight.by_rotation, weight.restoring)
        upright = bool((np.linalg.eigvalsh(held.dynamics.stiffness)[:, 0] > 0.0).all())
        moved = still + held.lag(still) if upright else still  # it would fall over, and not vibrate
        strains, rocking = np.split(moved, [self.still.shape[1]], axis=1)
        return strains - self.still - self._usual_lag, np.pad(rocking, ((0, 0), (0, 1)))

    @cached_property
    def strains_by_drive(self) -> dict[str, Floats]:
        """Derivatives of the quasi-static strains by the parts of the drive; see ``Stage``."""
        return _strains_by_drive(self.resting)

    @property
    def couples(self) -> Floats:
        """Couples that strain the arm at rest as it vibrates without effects, shape (samples, strains)."""
        return self.arm.couples(self._usual_lag)

    @cached_property
    def _usual_lag(self) -> Floats:
        return self.arm.lag(self.still)


@dataclass(frozen=True)
class StillChange:
    """What effects change of an arm that does not vibrate, to first order; it adds up.

    Args:
        predictions: Of the predictions, shape (samples, rows, ...).
        at_rest: Of the strains at rest, shape (samples, strains, ...).
        there: The same by the poses through which the arm vibrates.
    """

    predictions: Floats
    at_rest: Floats
    there: Floats

    @classmethod
    def none(cls, stage: "Stage") -> "StillChange":
        """Return no change."""
        assert stage.vibrations is not None
        strains = np.zeros_like(stage.vibrations.still)
        return cls(np.zeros(stage.residual.shape), strains, strains)

    def plus(self, other: "StillChange") -> "StillChange":
        """Return both changes."""
        return StillChange(
            self.predictions + other.predictions, self.at_rest + other.at_rest, self.there + other.there
        )


@dataclass(frozen=True)
class Action:
    """What an effect does to an arm that vibrates.

    Args:
        still: What it changes at rest; of a law of the material, what its segments leave of that.
        modal: What it does to masses and damping.
        spot: Where it does so.
        stiffness: Factor on the stiffness of the segments there, shape (samples,), if it states that.
        segments: Equivalent segments, of a law of the material.
    """

    still: StillChange
    modal: ModalChange
    spot: Spot
    stiffness: Floats | None
    segments: tuple[EquivalentSegment, ...]

    def alter(self, arm: VibratingArm) -> VibratingArm:
        """Return an arm as it vibrates with the effect; itself, where that is as before."""
        added, ratio, chosen = self.modal.added_mass, self.modal.mass_ratio, np.repeat(self.spot.segments, 4)
        if added != 0.0 or ratio != 1.0:
            masses = np.zeros(arm.dynamics.places.shape[1])
            masses[self.spot.section] = added
            arm = arm.heavier(ratio, masses)
        if self.modal.inertia_time != 0.0 or self.modal.damping_time != 0.0:
            arm = arm.slower(chosen, self.modal.inertia_time, self.modal.damping_time)
        if self.stiffness is not None:
            arm = arm.stiffer(chosen, self.stiffness)
        if self.segments:
            stiffness, damping_times = np.ones((len(chosen),) * 2), np.zeros((len(chosen),) * 2)
            for one in self.segments:
                bends = one.bends, one.bends
                stiffness[bends] = one.stiffness_factor
                damping_times[bends] = one.damping_time * one.stiffness_factor
            arm = arm.scaled(stiffness, damping_times)
        return arm


@dataclass(frozen=True)
class Stage:
    """A session on the calibrated model.

    Args:
        setting: Calibration.
        arm: The arm linearised along the calibrated drive.
        exact: The arm itself.
        world: What effects may refer to.
        suite: The sensors, aligned.
        drive: The calibrated drive.
        vibrations: How the arm vibrates, where recordings show that.
        vibration_error_std: Error of the model of the vibration, where there is one, shape (samples, rows).
        observed: The same session where effects see the arm, if that is elsewhere; see ``pose.py``.
    """

    session: Session
    setting: Setting
    arm: LinearisedArm
    exact: SimulatedArm
    world: World
    suite: SensorSuite
    drive: Drive
    vibrations: Vibrations | None = None
    vibration_error_std: Floats | None = None
    observed: "Stage | None" = None

    @cached_property
    def base(self) -> Floats:
        """Predicted readings without effects, stacked, shape (samples, readings)."""
        predicted: Floats = self.suite.predict(self.arm.baseline.frames)
        return predicted

    @cached_property
    def couple_jacobian(self) -> Floats:
        """Derivative of the predictions by the segments' couples, shape (samples, rows, 4 segments)."""
        response = self.arm.baseline
        samples, sections = response.frames.positions.shape[:2]
        by_wrench = self.twist_jacobian @ response.load_jacobian
        strains = self.arm.segments.rows(response.frames).reshape(samples, -1, 6 * sections)
        couple_jacobian: Floats = by_wrench @ np.swapaxes(strains, 1, 2)
        return couple_jacobian

    @cached_property
    def _strain_stiffness(self) -> tuple[Floats, Floats, Flags]:
        """What couples move, the stiffness against them, and the stable samples; see ``strain_stiffness``."""
        return strain_stiffness(self.arm.baseline, self.arm.segments)

    @cached_property
    def _strain_jacobian(self) -> Floats:
        """Derivative of the predictions by the strains, shape (samples, rows, 4 segments)."""
        by_couple, stiffness, _ = self._strain_stiffness
        by_strain: Floats = self.twist_jacobian @ by_couple @ stiffness
        return by_strain

    @cached_property
    def by_eigenstrain(self) -> Floats:
        """Derivative of the predictions by eigenstrains, shape (samples, rows, 4 segments)."""
        return self.prediction.eigenstrain_jacobian

    @property
    def with_events(self) -> "Stage":
        """The same stage with what was read during events, which no fit may see."""
        session = self.session.with_events
        return self if session is self.session else replace(self, session=session)

    def innovation(self, readings: Floats) -> Floats:
        """Compare stacked readings with the prediction without effects, shape (samples, rows)."""
        innovation: Floats = self.suite.sensitivity(self.arm.baseline.frames, readings).innovation
        return np.where(self.arm.baseline.converged[:, None], innovation, np.nan)

    @cached_property
    def residual(self) -> Floats:
        """Measured minus predicted, shape (samples, rows); NaN where lost."""
        return self.innovation(self.session.readings)

    @cached_property
    def reading_rows(self) -> Floats:
        """Readings as rows: lengths and angles from the pose that is predicted for the first sample."""
        frames = self.arm.baseline.frames
        first = Frames(
            np.broadcast_to(frames.positions[:1], frames.positions.shape),
            np.broadcast_to(frames.rotations[:1], frames.rotations.shape),
        )
        rows: Floats = self.suite.sensitivity(first, self.session.readings).innovation
        return rows

    @cached_property
    def model_error_std(self) -> Floats:
        """What vibrations after fast changes may add to what the model gives, shape (samples, rows).

        Where the model does not vibrate, a change of bend within ``SUDDEN`` seconds decays with the time
        constant ``RINGDOWN``; the share ``RINGING`` of it counts as uncertain, on a lever of ``LEVER`` for
        positions.
        """
        if self.vibration_error_std is not None:
            return self.vibration_error_std
        bends = self.arm.baseline.strains[..., :2].reshape(self.session.samples, -1)
        back = max(1, round(SUDDEN / self.session.step))
        changes = np.zeros(self.session.samples)
        if back * self.session.step < RINGDOWN and self.session.samples > back:
            change = np.abs(bends[back:] - bends[:-back]).max(axis=1)
            changes[back:] = change
            changes = fading(self.session.clock, changes)
        uncertain: Floats = RINGING * changes[:, None] * self.lever
        return uncertain

    @cached_property
    def lever(self) -> Floats:
        """What an angle of one radian is worth in each row [rad, m], shape (rows,)."""
        return np.array([LEVER if unit == "m" else 1.0 for unit in self.suite.units])

    @cached_property
    def compliance(self) -> Floats:
        """How much further than usual the arm gives way to the same error of its model, shape (samples,).

        Close to a limit point small errors of stiffness or load move it far: what a model gets wrong of its
        pose grows with its compliance. Where effects see the arm elsewhere, the larger of both counts.
        """
        return np.maximum(self._relative_compliance, self._there._relative_compliance)

    @cached_property
    def _relative_compliance(self) -> Floats:
        """Compliance over its median, at least one, shape (samples,).

        It is what the couples of all segments move, each of a size that usually strains by as much.
        """
        known = self.arm.baseline.converged & np.isfinite(self.couple_jacobian).all(axis=(1, 2))
        if self.vibrations is not None:
            known &= self._strain_stiffness[-1]
        if not known.any():
            return np.ones(len(known))
        _, stiffness, _ = self._strain_stiffness
        usual = np.median(np.diagonal(stiffness[known], axis1=1, axis2=2), axis=0)
        couples = usual * np.tile([1.0, 1.0, 1.0, LEVER], self.arm.segments.count)
        sizes = np.linalg.norm(self.couple_jacobian * couples / self.lever[:, None], axis=(1, 2))
        relative: Floats = np.where(known, np.maximum(sizes / np.median(sizes[known]), 1.0), UNSTABLE)
        return relative

    def error_std(self, scale: Floats) -> Floats:
        """Return the standard deviation of each residual, shape (samples, rows).

        Args:
            scale: That of each row where the arm is as compliant as usual and does not vibrate.
        """
        std: Floats = np.hypot(scale * self.compliance[:, None], self.model_error_std)
        return std

    def change(
        self, effects: Sequence[PlacedEffect], *, exact: bool = False, beside: Sequence[PlacedEffect] = ()
    ) -> Floats:
        """Return by how much effects change the predictions, shape (samples, rows).

        To first order effects add up but in how the arm vibrates; those that answer to the response need a
        search for a fixed point.

        Args:
            effects: The effects.
            exact: Correct that by what the model itself predicts at some samples, but for sensors.
            beside: Effects on which these come, and with which the arm vibrates already.
        """
        answering = [placed for placed in effects if placed.effect.responds_to_own_effect]
        sensing = [placed for placed in effects if placed.effect.hook == "sensing"]
        inner = [placed for placed in effects if placed not in (*answering, *sensing)]
        none, there = np.zeros(self.residual.shape), self._there
        before = [placed for placed in beside if there.vibrates_with(placed)]
        change: Floats = sum(
            (there.first_order(placed) for placed in sensing), there.together([*before, *inner])
        )
        change = change - there.together(before)
        pushed = there._simulated(answering) if answering else none
        if exact and (inner or answering):
            still = sum((there.first_order(placed, vibrating=False) for placed in inner), pushed)
            nodes, relative = self._exact.nodes, self.compliance[:, None]
            beyond = self._solved((*inner, *answering)) - self._solved_plain - still[nodes]
            change = change + relative * self._exact.between(beyond / relative[nodes])
        return change + pushed

    @property
    def _there(self) -> "Stage":
        """The same session where effects see the arm."""
        return self if self.observed is None else self.observed

    def moved(self, eigenstrains: Floats) -> "Stage":
        """Return the same session, linearised where eigenstrains would have its arm.

        They bear no load: the strains of the response, which laws of the material see, stay those without.

        Args:
            eigenstrains: Shape (samples, segments, 4).
        """

        def strained(arm: LinearisedArm) -> LinearisedArm:
            there = arm.respond(arm.drive.strained(eigenstrains))
            return replace(arm, baseline=replace(there, strains=there.strains - eigenstrains))

        vibrations = self.vibrations and replace(self.vibrations, resting=strained(self.vibrations.resting))
        return replace(self, arm=strained(self.arm), vibrations=vibrations, observed=None)

    @cached_property
    def _recent(self) -> Recent[Floats]:
        """What effects were last found to change."""
        return Recent(KEPT)

    @cached_property
    def _recent_actions(self) -> Recent[Action]:
        """What effects were last found to do to the vibration."""
        return Recent(ACTIONS)

    def _simulated(self, effects: Sequence[PlacedEffect]) -> Floats:
        """Return by how much effects that answer to the response change the predictions, to first order."""
        return self._recent.get(("simulated", *_keys(effects)), lambda: self._simulate(effects))

    def _simulate(self, effects: Sequence[PlacedEffect]) -> Floats:
        touching = met(effects, self.signals)
        change = np.zeros(self.residual.shape)
        if len(touching):  # elsewhere the arm answers to the drive as it is
            there = self.arm.at(touching)
            simulation = simulate_with(effects, there, self.world, there.drive)
            readings = self.suite.predict(simulation.response.frames)
            change[touching] = self.suite.sensitivity(there.baseline.frames, readings).innovation
        return np.where(self.arm.baseline.converged[:, None], change, np.nan)

    @cached_property
    def _exact(self) -> ExactModel:
        """The model itself along the session."""
        return ExactModel(self.exact, self.drive, self.arm.baseline, self.world, self._there.arm.baseline)

    @cached_property
    def _solved_plain(self) -> Floats:
        """What the model itself gives without effects, against its linearisation, shape (nodes, rows).

        NaN where it has found another equilibrium: that is no correction of this one.
        """
        plain = self._solved(())
        elsewhere = np.any(np.abs(plain) > ELSEWHERE * self.lever, axis=1)
        return np.where(elsewhere.reshape(-1, 1), np.nan, plain)

    def _solved(self, effects: Sequence[PlacedEffect]) -> Floats:
        """Return what the model itself predicts under effects, minus the prediction, shape (nodes, rows)."""
        return self._recent.get(("solved", *_keys(effects)), lambda: self._solve(effects))

    def _solve(self, effects: Sequence[PlacedEffect]) -> Floats:
        nodes = self._exact.nodes
        drive, response = self._exact.under(effects)
        back = np.swapaxes(exp(self._usual(drive, effects)[nodes]), -1, -2)
        frames = Frames(
            np.einsum("tij,tsj->tsi", back, response.frames.positions),
            back[:, None] @ response.frames.rotations,
        )
        near = self.arm.baseline.at(nodes)
        readings = self.suite.predict(frames)
        readings = np.where(response.converged[:, None], readings, np.nan)
        innovation: Floats = self.suite.sensitivity(near.frames, readings).innovation
        return np.where(near.converged[:, None], innovation, np.nan)

    def first_order(self, placed: PlacedEffect, *, vibrating: bool = True) -> Floats:
        """Return by how much an effect changes the predictions to first order, shape (samples, rows).

        What it sees of the response is the response without it: for a material effect exactly what it asks
        for, for loads and supports that depend on the response the first step towards it.

        Args:
            placed: The effect.
            vibrating: Whether the arm vibrates about what the effect changes, as it does about all else.
        """
        return self._recent.get(
            (vibrating, placed.key), lambda: self._first_order(placed, vibrating=vibrating)
        )

    def _first_order(self, placed: PlacedEffect, *, vibrating: bool) -> Floats:
        if not placed.field:
            return self.innovation(self._misread(placed, self.base))
        if vibrating and self.vibrates_with(placed):
            return self._vibrated((placed,))
        drive = self.drive
        change, _ = placed.change(self.signals)
        if placed.field == "base_rotation":
            modal = placed.effect.modal(placed.theta)
            if modal.base_compliance > 0.0:
                change = self._base_weight.at_rest(change, modal.base_compliance, self._strain_stiffness[1])
            rotated = placed.apply(drive, change)
            usual = replace(drive, base_rotation=self._usual(rotated, (placed,)))
            return _applied(self.twist_jacobian, self.arm.twists(rotated) - self.arm.rigid(usual))
        return _applied(self.by_drive[placed.field], change.reshape(drive.samples, -1))

    def together(self, effects: Sequence[PlacedEffect]) -> Floats:
        """Return by how much effects change the predictions together, to first order, shape (samples, rows).

        What they change at rest adds up. How the arm vibrates does not: one that is heavier and stiffer by as
        much vibrates as before.
        """
        none = np.zeros(self.residual.shape)
        joint = [placed for placed in effects if self.vibrates_with(placed)]
        if len(joint) < 2:
            return sum((self.first_order(placed) for placed in effects), none)
        apart: Floats = sum((self.first_order(p) for p in effects if not self.vibrates_with(p)), none)
        return apart + self._recent.get(("together", *_keys(joint)), lambda: self._vibrated(joint))

    def vibrates_with(self, placed: PlacedEffect) -> bool:
        """Return whether an effect acts on a vibration: not on a sensor, a rigid base or by contact."""
        if self.vibrations is None or not placed.field or placed.effect.responds_to_own_effect:
            return False
        return placed.field != "base_rotation" or placed.effect.modal(placed.theta).base_compliance > 0.0

    def _vibrated(self, effects: Sequence[PlacedEffect]) -> Floats:
        """Return what effects change of the predictions while the arm vibrates with all of them."""
        assert self.vibrations is not None
        bases = [placed for placed in effects if placed.field == "base_rotation"]
        actions = [self._action(placed) for placed in effects if placed.field != "base_rotation"]
        still, arm = StillChange.none(self), self.vibrations.arm
        for action in actions:
            still, arm = still.plus(action.still), action.alter(arm)
        if bases:
            return self._rocked(bases[0], still, arm)  # there is one place for a base
        return self._with_vibration(still, None if arm is self.vibrations.arm else arm)

    def _action(self, placed: PlacedEffect) -> Action:
        """Return what an effect does to an arm that vibrates; not that of a base."""
        return self._recent_actions.get(placed.key, lambda: self._acting(placed))

    def _acting(self, placed: PlacedEffect) -> Action:
        assert self.vibrations is not None
        segments: tuple[EquivalentSegment, ...] = ()
        change, _ = placed.change(self.signals)
        stiffness = placed.stiffness(self.signals.time)
        if placed.effect.only_vibrates:
            change = np.zeros_like(change)
        elif stiffness is not None:
            # An arm of another stiffness vibrates about what changes at rest.
            change, _ = placed.change(self._signals_at_rest)
        elif placed.effect.detunes:
            at_rest, _ = placed.change(self._signals_at_rest)
            least = -self.vibrations.arm.damping[1]
            segments, change = linearise(self._vibration, change, at_rest, placed.spot.segments, least)
        still = self._still(placed.field, change.reshape(self.drive.samples, -1))
        return Action(still, placed.effect.modal(placed.theta), placed.spot, stiffness, segments)

    def first_order_of_many(self, effects: Sequence[PlacedEffect]) -> Floats:
        """Return that of each of some effects, alone; ``superposes`` holds of them, and they change one part.

        Returns:
            Shape (samples, rows, effects).
        """
        changes = [placed.change(self.signals)[0].reshape(self.drive.samples, -1) for placed in effects]
        field, change = effects[0].field, np.stack(changes, axis=-1)
        if self.vibrations is None:
            return _applied(self.by_drive[field], change)
        return self._with_vibration(self._still(field, change))

    def _still(self, field: str, change: Floats) -> StillChange:
        """Return what a change of a part of the drive, shape (samples, inputs, ...), changes at rest.

        By poses that it only swings through, close to a limit point, it would yield far: it yields at rest.
        """
        assert self.vibrations is not None
        at_rest, there = (
            np.nan_to_num(_applied(by_drive[field], change))
            for by_drive in (self.vibrations.strains_by_drive, self.strains_by_drive)
        )
        return StillChange(_applied(self.by_drive[field], change), at_rest, there)

    def _with_vibration(self, still: StillChange, other: VibratingArm | None = None) -> Floats:
        """Return what changes of the predictions while the arm vibrates, shape (samples, rows, ...).

        Args:
            still: What changes at rest.
            other: The arm as it vibrates then, if that is another way.
        """
        assert self.vibrations is not None
        return self._read(still.predictions, self.vibrations.strains(still.at_rest, other) - still.there)

    def _read(self, moved: Floats, strained: Floats) -> Floats:
        """Add what further strains change of the predictions, shape (samples, rows, ...).

        Args:
            moved: What changes of them without these, shape (samples, rows, ...).
            strained: The strains, shape (samples, strains, ...).
        """
        *_, stable = self._strain_stiffness
        known = stable.reshape(-1, *(1,) * (strained.ndim - 1))
        return np.where(known, moved + _applied(self._strain_jacobian, strained), 0.0)

    def _rocked(self, base: PlacedEffect, still: StillChange, other: VibratingArm) -> Floats:
        """Return what a compliant base and other effects change of the predictions, shape (samples, rows).

        Args:
            base: The base.
            still: What the other effects change at rest.
            other: The arm as it vibrates with these.
        """
        assert self.vibrations is not None
        rotation, _ = base.change(self._signals_at_rest)
        strains, rocking = self.vibrations.rocked(
            other, still.at_rest, np.nan_to_num(rotation), base.effect.modal(base.theta), self.world
        )
        rotated = base.apply(self.drive, rocking)
        usual = replace(self.drive, base_rotation=self._usual(rotated, (base,)))
        rigid = self.arm.rigid(rotated) - self.arm.rigid(usual)
        return self._read(still.predictions + _applied(self.twist_jacobian, rigid), strains - still.there)

    @cached_property
    def signals(self) -> Signals:
        """What effects see of the session without them."""
        return signals_of(self.drive, self.world, self.arm.baseline)

    @cached_property
    def _signals_at_rest(self) -> Signals:
        """What effects would see of the arm if it did not vibrate."""
        assert self.vibrations is not None
        resting = self.vibrations.resting
        return signals_of(resting.drive, self.world, resting.baseline)

    @cached_property
    def _base_weight(self) -> BaseWeight:
        """How the arm's weight acts on a base that yields."""
        return BaseWeight.of(self.world, self.drive, self.arm.baseline, self.strains_by_drive["gravity"])

    @cached_property
    def _vibration(self) -> BendVibration:
        """How the arm vibrates, where both it and the arm at rest are known."""
        assert self.vibrations is not None
        still = self.vibrations.resting.baseline
        *_, stable = self._strain_stiffness
        return BendVibration.of(
            self.session.clock, self.arm.baseline.strains, still.strains, stable & still.converged
        )

    @cached_property
    def by_drive(self) -> dict[str, Floats]:
        """Derivatives of the predictions by the parts of the drive that act through deformation."""
        return _by_part(self.input_jacobian, self.by_eigenstrain, self.drive)

    @cached_property
    def strains_by_drive(self) -> dict[str, Floats]:
        """Derivatives of the strains by these, each of shape (samples, 4 segments, inputs)."""
        return _strains_by_drive(self.arm)

    def _usual(self, drive: Drive, effects: Sequence[PlacedEffect]) -> Floats:
        """Return the base's rotation that the laboratory's registration has removed, shape (samples, 3)."""
        taken = recorded_rotation(drive.base_rotation, effects) if self.suite.base_recorded else np.zeros(3)
        return np.broadcast_to(taken, drive.base_rotation.shape)

    def _misread(self, placed: PlacedEffect, truth: Floats) -> Floats:
        """Return stacked readings as an effect of sensing changes them, shape (samples, readings)."""
        readings = truth.copy()
        for sensor in self.suite.measurements:
            if sensor.name == placed.spot.place.sensor:
                entries = self.suite.reading_slices[sensor.name]
                readings[:, entries], _ = placed.misread(self.signals, sensor, truth[:, entries])
        return readings

    @cached_property
    def twist_jacobian(self) -> Floats:
        """Derivative of the predictions by the sections' twists, shape (samples, rows, 6 sections)."""
        rows: Floats = np.nan_to_num(self.suite.sensitivity(self.arm.baseline.frames, self.base).twists)
        return rows

    @cached_property
    def input_jacobian(self) -> Floats:
        """Derivative of the predictions by pressures, wrenches and gravity, shape (samples, rows, inputs)."""
        input_jacobian: Floats = self.twist_jacobian @ self.arm.baseline.input_jacobian
        return input_jacobian

    @cached_property
    def prediction(self) -> Prediction:
        """What the calibrated model predicts along the session, for derivatives by a calibration's unknowns.

        The sensors are differentiated about the prediction, not the readings, which effects have changed.
        """
        session = self.session
        loads = session.wrenches.reshape(session.samples, -1)
        return Prediction(
            self.setting,
            self.suite,
            self.arm.baseline,
            session.pressures,
            loads,
            session.gravity[0],
            self.base,
            np.zeros(self.twist_jacobian.shape[:2]),
            self.twist_jacobian,
        )


def _keys(effects: Sequence[PlacedEffect]) -> tuple[Hashable, ...]:
    return tuple(placed.key for placed in effects)


def _by_part(by_input: Floats, by_eigenstrain: Floats, drive: Drive) -> dict[str, Floats]:
    """Sort derivatives by pressures, wrenches and gravity, and by eigenstrains, by these parts of a drive."""
    chambers = drive.pressures.shape[1]
    return {
        "pressures": by_input[..., :chambers],
        "wrenches": by_input[..., chambers:-3],
        "gravity": by_input[..., -3:],
        "eigenstrains": by_eigenstrain,
    }


def _strains_by_drive(arm: LinearisedArm) -> dict[str, Floats]:
    """Return derivatives of the strains by the parts of a drive; see ``Stage.strains_by_drive``."""
    response = arm.baseline
    samples, sections = response.frames.positions.shape[:2]
    rows = arm.segments.rows(response.frames).reshape(samples, -1, 6 * sections)
    return _by_part(rows @ response.input_jacobian, rows @ response.eigenstrain_jacobian, arm.drive)


def _applied(slopes: Floats, change: Floats) -> Floats:
    """Multiply derivatives, shape (samples, rows, inputs), with changes, shape (samples, inputs, ...)."""
    applied: Floats = slopes @ change if change.ndim > 2 else np.einsum("tri,ti->tr", slopes, change)
    return applied


def superposes(placed: PlacedEffect) -> bool:
    """Return whether what an effect changes is only a change of the drive, to first order."""
    modal = placed.effect.modal(placed.theta)
    by_drive = placed.field not in ("", "base_rotation") and not placed.effect.responds_to_own_effect
    return by_drive and modal.vibrates_alike and placed.effect.stiffness is None


def build_stage(model: Model, session: Session, setting: Setting) -> Stage:
    """Solve the calibrated model along a session and linearise it there.

    Args:
        model: The model.
        session: The session.
        setting: Calibration.
    """
    arm = model.arm(setting)
    drive = session.drive(setting.actuation, arm.segments.count)
    response = arm.respond(drive)
    suite = setting.aligned(session.suite)
    sensors = tuple(m.name for m in suite.measurements)
    stiffness = stiffness_along(arm.segments, response.frames, response.load_jacobian)
    world = World.of(
        model.specimen, arm.segments, model.sections, stiffness, sensors, actuation=setting.actuation
    )
    return Stage(session, setting, LinearisedArm(arm.segments, drive, response), arm, world, suite, drive)


def fading(clock: Floats, sizes: Floats) -> Floats:
    """Return the largest of late of some sizes, forgotten with ``RINGDOWN``, shape (samples, ...)."""
    envelope, kept = sizes.copy(), np.exp(-np.diff(clock) / RINGDOWN)
    for k in range(1, len(envelope)):
        envelope[k] = np.maximum(envelope[k], envelope[k - 1] * kept[k - 1])
    return envelope


def thinned(session: Session, count: int) -> Session:
    """Keep about ``count`` samples, evenly spread."""
    keep = np.zeros(session.samples, dtype=bool)
    keep[np.unique(np.linspace(0, session.samples - 1, min(count, session.samples)).astype(int))] = True
    return replace(session.thin(keep))
