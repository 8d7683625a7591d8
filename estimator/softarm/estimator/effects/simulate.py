"""The arm with effects: effects that shape the drive, those that answer to the response, and the sensors.

A material effect turns the strain u, which the segment would have without it, into eps(u); in the model
eps - u is a free strain. What depends on the response is found as a fixed point, sample by sample: strains,
loads and rotations of the support with Aitken's relaxation, which needs two or three passes, since an effect
sees the strain without its own share; walls and cords with the compliance of the arm (``Springs``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.effects.effect import Memory, Signals
from softarm.estimator.effects.placed import PlacedEffect, signals_of
from softarm.estimator.effects.springs import together
from softarm.estimator.effects.world import World
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.simulation import Drive, RespondingArm

PASSES = 40
"""Answers of the arm after which a search ends anyhow."""
TOLERANCE = 1e-7
"""Change of a strain [rad, m], a base rotation [rad] or a wrench [N, N m] that ends the search."""
SMALLEST_STEP = 1e-6
"""Least share of a residual that Aitken's relaxation takes."""
ANEW = 4
"""Passes after which the compliance is that of the pose by then."""
STALLS, SLOWEST = 0.7, 1.0 / 16.0
"""Share of the change before from which on a change of forces stalls after a whole step, for the arm gives
way otherwise than its compliance says, and half as much of it is taken; the least share that is taken."""


@dataclass(frozen=True)
class Simulation:
    """An arm with effects over a stretch of time.

    Args:
        drive: What acted in the end, effects included.
        response: What the arm did.
        readings: Predicted reading of each sensor, effects of sensing included.
        memories: Memory of each effect after the last sample.
        unsettled: Samples at which no fixed point was found, shape (samples,).
    """

    drive: Drive
    response: ArmResponse
    readings: Mapping[str, Floats]
    memories: tuple[Memory, ...]
    unsettled: Flags

    @property
    def settled(self) -> bool:
        """Whether the fixed point was found everywhere."""
        return not self.unsettled.any()


def simulate_with(
    effects: Sequence[PlacedEffect],
    arm: RespondingArm,
    world: World,
    drive: Drive,
    suite: SensorSuite | None = None,
    memories: Sequence[Memory] | None = None,
    near: ArmResponse | None = None,
    passes: int = PASSES,
) -> Simulation:
    """Simulate an arm with effects.

    Args:
        effects: The effects, in the order in which they act on pressures and readings.
        arm: The arm without them.
        world: What the effects refer to.
        drive: What acts on it without them.
        suite: Sensors whose readings to predict.
        memories: What an earlier stretch left behind, one for each effect.
        near: A response close by, from which the search begins.
        passes: Answers of the arm after which the search ends anyhow.

    Returns:
        The simulation, with the memories to continue it.
    """
    before = tuple(memories) if memories is not None else ((),) * len(effects)
    after = list(before)
    drive = _shape_drive(effects, world, drive, before, after)
    contacts = [placed for placed in effects if placed.effect.springs]
    others = [k for k, placed in enumerate(effects) if placed.answers and not placed.effect.springs]
    base, shares = drive, {k: _no_share(effects[k], drive) for k in others}
    old: dict[int, tuple[Floats, Floats]] = {}
    response = arm.respond(drive, near, jacobians=True)
    forces = Forces.none(contacts, drive)
    open_samples = np.full(drive.samples, bool(shares or contacts))
    for number in range(1, passes if open_samples.any() else 1):
        residuals = {}
        for k, share in shares.items():
            wanted, after[k] = _share(effects[k], world, drive, response, share, before[k])
            residuals[k] = wanted - share
        balanced = forces.balanced(signals_of(drive, world, response), response.load_jacobian)
        changes = [*residuals.values(), balanced.change]
        open_samples = np.any([_largest(change) >= TOLERANCE for change in changes], axis=0)
        if not open_samples.any():
            break
        # Samples that have settled stay as they are, so that no arm need answer them again.
        for k, residual in residuals.items():
            step = _relaxed(residual, old.get(k))
            old[k] = (residual, step)
            shares[k] = shares[k] + _spread(np.where(open_samples, step, 0.0), residual) * residual
        forces = forces.taken(balanced, open_samples)
        loaded = _loaded(base, effects, shares)
        drive = replace(loaded, wrenches=loaded.wrenches + forces.wrenches)
        anew = {"jacobians": True} if contacts and number % ANEW == 0 else {}
        response = arm.respond(drive, response, **anew)
    readings = _readings(effects, world, drive, response, suite, before, after)
    return Simulation(drive, response, readings, tuple(after), open_samples)


@dataclass(frozen=True)
class Forces:
    """Forces of walls and cords along a drive.

    Args:
        effects: The walls and cords.
        forces: Of each spring [N], shape (samples, springs); empty before the first balance.
        wrenches: Theirs on the sections, shape (samples, sections, 6).
        change: Largest change of a wrench that would balance [N, N m], shape (samples,).
        share: Of a change that is taken, shape (samples,).
    """

    effects: Sequence[PlacedEffect]
    forces: Floats
    wrenches: Floats
    change: Floats
    share: Floats

    @classmethod
    def none(cls, effects: Sequence[PlacedEffect], drive: Drive) -> "Forces":
        """Begin without forces."""
        samples = drive.samples
        no_wrenches, all_of_it = np.zeros_like(drive.wrenches), np.ones(samples)
        return cls(effects, np.zeros((samples, 0)), no_wrenches, np.full(samples, np.inf), all_of_it)

    def balanced(self, signals: Signals, compliance: Floats) -> "Forces":
        """Balance the springs where they are in the response to these forces.

        Args:
            signals: Of that response.
            compliance: Section twists per unit of each wrench, shape (samples, 6 sections, 6 sections).
        """
        if not self.effects:
            return replace(self, change=np.zeros_like(self.change))
        springs = together([placed.springs(signals) for placed in self.effects])
        forces = self.forces if self.forces.size else np.zeros_like(springs.extensions)
        step = springs.balanced(forces, compliance) - forces
        change = _largest(springs.wrenches(forces + step) - self.wrenches)
        stalled = change > (1.0 - (1.0 - STALLS) * self.share) * self.change
        share = np.where(stalled, np.maximum(0.5 * self.share, SLOWEST), np.minimum(2.0 * self.share, 1.0))
        forces = forces + share[:, None] * step
        return Forces(self.effects, forces, springs.wrenches(forces), change, share)

    def taken(self, balanced: "Forces", samples: Flags) -> "Forces":
        """Take the balanced forces at some samples, shape (samples,)."""
        if not self.forces.size:
            return balanced
        return Forces(
            self.effects,
            np.where(samples[:, None], balanced.forces, self.forces),
            np.where(samples[:, None, None], balanced.wrenches, self.wrenches),
            balanced.change,
            balanced.share,
        )


def advance_with(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    response: ArmResponse,
    memories: Sequence[Memory] | None = None,
) -> tuple[Drive, tuple[Memory, ...]]:
    """Shape one instant's drive by effects, as seen in the last known response: the seam for a live loop.

    Args:
        effects: The effects.
        world: What they refer to.
        drive: What acts without them, one sample, with the couples that this function gave before.
        response: ArmResponse of the instant before, one sample.
        memories: Memories of the instant before.

    Returns:
        The drive with the effects' share in place of the former couples, and the memories for the next.
    """
    before = tuple(memories) if memories is not None else ((),) * len(effects)
    after = list(before)
    base = _shape_drive(effects, world, replace(drive, couples=np.zeros_like(drive.couples)), before, after)
    shares = {}
    for k, effect in enumerate(effects):
        if effect.answers:
            # All material effects together own the couples: each sees the strain without any of them.
            material = effect.field == "eigenstrains"
            previous = world.strains(drive.couples) if material else _no_share(effect, drive)
            shares[k], after[k] = _share(effect, world, drive, response, previous, before[k])
    shaped = _loaded(base, effects, shares)
    couples = shaped.couples + world.couples(shaped.eigenstrains)
    return replace(shaped, couples=couples, eigenstrains=np.zeros_like(couples)), tuple(after)


def standing_pressures(effects: Sequence[PlacedEffect], world: World, drive: Drive) -> Floats:
    """Return what effects make of pressures that have long stood still, shape (samples, chambers)."""
    none: tuple[Memory, ...] = ((),) * len(effects)
    return _shape_drive(effects, world, drive, none, list(none)).pressures


def recorded_rotation(base_rotation: Floats, effects: Sequence[PlacedEffect]) -> Floats:
    """Return the rotation of a recorded base at its mean pose, which registers the laboratory [rad].

    Args:
        base_rotation: Rotation of the base along the recording, shape (samples, 3).
        effects: The effects that rotate it, some of them beneath what is recorded.

    Returns:
        Shape (3,).
    """
    hidden = [placed.effect.hidden_rotation(placed.theta) for placed in effects]
    shown: Floats = base_rotation.mean(axis=0) - sum(hidden, np.zeros(3))
    return shown


def _shape_drive(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    before: tuple[Memory, ...],
    after: list[Memory],
) -> Drive:
    """Let effects act on pressures and gravity, which no response changes."""
    for k, placed in enumerate(effects):
        # What happens before a pressure sensor is part of what it measured.
        measured = placed.effect.hook == "command" and world.pressures_measured
        if placed.field and not placed.answers and not measured:
            change, after[k] = placed.change(signals_of(drive, world), before[k])
            drive = placed.apply(drive, change)
    return drive


def _no_share(placed: PlacedEffect, drive: Drive) -> Floats:
    """No strain, wrench or rotation by an effect, in the shape of its part of the drive."""
    return np.zeros_like(getattr(drive, placed.field))


def _share(
    placed: PlacedEffect, world: World, drive: Drive, response: ArmResponse, previous: Floats, before: Memory
) -> tuple[Floats, Memory]:
    """Compute what an effect adds in a response that already holds its own share."""
    signals = signals_of(drive, world, response)
    if placed.field == "eigenstrains":
        signals = replace(signals, strains=signals.strains - previous)
    share, memory = placed.change(signals, before)
    return share.reshape(previous.shape), memory


def _largest(residual: Floats) -> Floats:
    """Return the largest size of each sample's residual, shape (samples,)."""
    largest: Floats = np.abs(residual).reshape(len(residual), -1).max(axis=1, initial=0.0)
    return largest


def _spread(step: Floats, residual: Floats) -> Floats:
    """Return a number of each sample the dimensions of a residual."""
    return step.reshape(-1, *(1 for _ in residual.shape[1:]))


def _relaxed(residual: Floats, old: tuple[Floats, Floats] | None) -> Floats:
    """Return the share of each sample's residual to take (Aitken), shape (samples,)."""
    if old is None:
        return np.ones(len(residual))
    before = old[0].reshape(len(residual), -1)
    change = residual.reshape(len(residual), -1) - before
    square = (change**2).sum(axis=1)
    step = -old[1] * (before * change).sum(axis=1) / np.where(square > 0.0, square, 1.0)
    return np.where(square > 0.0, np.clip(step, SMALLEST_STEP, 2.0), 1.0)


def _loaded(drive: Drive, effects: Sequence[PlacedEffect], shares: dict[int, Floats]) -> Drive:
    """Add the effects' shares to a drive."""
    for k, share in shares.items():
        drive = effects[k].apply(drive, share)
    return drive


def _readings(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    response: ArmResponse,
    suite: SensorSuite | None,
    before: tuple[Memory, ...],
    after: list[Memory],
) -> dict[str, Floats]:
    """Predict the readings, effects of sensing included."""
    if suite is None:
        return {}
    sensors = {sensor.name: sensor for sensor in suite.measurements}
    readings = {name: sensor.predict(response.frames) for name, sensor in sensors.items()}
    for k, placed in enumerate(effects):
        if placed.effect.hook == "sensing" and placed.spot.place.sensor in readings:
            name, signals = placed.spot.place.sensor, signals_of(drive, world, response)
            readings[name], after[k] = placed.misread(signals, sensors[name], readings[name], before[k])
    return readings
