"""The arm with effects: effects that shape the drive, those that answer to the response, and the sensors.

A material effect turns the strain u, which the segment would have without it, into eps(u); in the model
eps - u is a free strain. What depends on the response (couples,
loads, yielding supports) is found as a fixed point with Aitken's relaxation, sample by sample. Since an
effect sees the strain without its own share, most need two or three passes, however strong or fast they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.effects import base_tilt
from softarm.estimator.effects.effect import Effect, Memory, Signals
from softarm.estimator.effects.world import Spot, World
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.sensing.measurement import Scene
from softarm.estimator.simulation import Arm, Drive, Response

Floats = NDArray[np.float64]

ITERATIONS = 40
TOLERANCE = 1e-7
"""Change of a strain [rad, m], a base rotation [rad] or a wrench [N, N m] that ends the search."""
FIRST_STEP = {"couple": 1.0, "load": 1e-4, "support": 1.0}
"""Share of the first gap to take: a stiff contact taken whole would throw the arm off the wall for good."""

SMALLEST_STEP = 1e-6
PRESSURES = ("pressure", "command")
"""Where effects enter that change pressures."""


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place, with its parameters.

    Args:
        effect: The effect.
        spot: Where it acts.
        theta: Its parameters, shape (parameters,).
    """

    effect: Effect
    spot: Spot
    theta: Floats

    def act(self, signals: Signals, memory: Memory) -> tuple[Floats, Memory]:
        """Run the effect over a stretch of time.

        What changes pressures changes those in the chambers. A calibration says what these are worth, and its
        curve, be it of the winding or of the rubber, goes with the pressure that is there.
        """
        actuation = self.spot.world.actuation
        if self.effect.hook not in PRESSURES or actuation is None:
            return self.effect.act(signals, self.theta, self.spot, memory)
        inside = actuation.to_measured(signals.pressures)
        changed, memory = self.effect.act(replace(signals, pressures=inside), self.theta, self.spot, memory)
        return signals.pressures + actuation.to_chamber(changed) - actuation.to_chamber(inside), memory


@dataclass(frozen=True)
class Simulation:
    """An arm with effects over a stretch of time.

    Args:
        drive: What acted in the end, effects included.
        response: What the arm did.
        readings: Predicted reading of each sensor, effects of sensing included.
        memories: Memory of each effect after the last sample.
        settled: Whether the fixed point was found.
        passes: Answers of the arm that it took.
    """

    drive: Drive
    response: Response
    readings: Mapping[str, Floats]
    memories: tuple[Memory, ...]
    settled: bool
    passes: int


def simulate_with(
    effects: Sequence[PlacedEffect],
    arm: Arm,
    world: World,
    drive: Drive,
    suite: SensorSuite | None = None,
    memories: Sequence[Memory] | None = None,
    near: Response | None = None,
) -> Simulation:
    """Simulate an arm with effects.

    Args:
        effects: The effects, in the order in which they act on pressures and readings.
        arm: The arm without them.
        world: What the effects refer to.
        drive: What acts on it without them.
        suite: Sensors whose readings to predict.
        memories: What an earlier stretch left behind, one for each effect.
        near: A response close by, where known.

    Returns:
        The simulation, with the memories to continue it.
    """
    before = tuple(memories) if memories is not None else ((),) * len(effects)
    after = list(before)
    drive = _shape_drive(effects, world, drive, before, after)
    base, shares = drive, {k: _no_share(e, drive) for k, e in enumerate(effects) if _answers(e)}
    old: dict[int, tuple[Floats, Floats]] = {}
    response = arm.respond(drive, near)
    passes, settled = 1, not shares
    while not settled and passes < ITERATIONS:
        gaps = {}
        for k, share in shares.items():
            wanted, after[k] = _share(effects[k], world, drive, response, share, before[k])
            gaps[k] = wanted - share
        settled = all(float(np.abs(gap).max(initial=0.0)) < TOLERANCE for gap in gaps.values())
        if settled:
            break
        for k, gap in gaps.items():
            step = _relaxed(gap, old.get(k), FIRST_STEP[effects[k].effect.hook])
            old[k] = (gap, step)
            shares[k] = shares[k] + step[:, None] * gap
        drive = _loaded(base, effects, shares)
        response = arm.respond(drive, response)
        passes += 1
    readings = _readings(effects, world, drive, response, suite, before, after)
    return Simulation(drive, response, readings, tuple(after), settled, passes)


def advance_with(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    response: Response,
    memories: Sequence[Memory] | None = None,
) -> tuple[Drive, tuple[Memory, ...]]:
    """Shape one instant's drive by effects, as seen in the last known response: the seam for a live loop.

    Args:
        effects: The effects.
        world: What they refer to.
        drive: What acts without them, one sample, with the couples that this function gave before.
        response: Response of the instant before, one sample.
        memories: Memories of the instant before.

    Returns:
        The drive with the effects' share in place of the former couples, and the memories for the next.
    """
    before = tuple(memories) if memories is not None else ((),) * len(effects)
    after = list(before)
    base = _shape_drive(effects, world, replace(drive, couples=np.zeros_like(drive.couples)), before, after)
    shares = {}
    for k, effect in enumerate(effects):
        if _answers(effect):
            # All material effects together own the couples: each sees the strain without any of them.
            known = world.strains(drive.couples).reshape(drive.samples, -1)
            own = known if effect.effect.hook == "couple" else _no_share(effect, drive)
            shares[k], after[k] = _share(effect, world, drive, response, own, before[k])
    shaped = _loaded(base, effects, shares)
    couples = shaped.couples + world.couples(shaped.free)
    return replace(shaped, couples=couples, free=np.zeros_like(couples)), tuple(after)


def standing_pressures(effects: Sequence[PlacedEffect], world: World, drive: Drive) -> Floats:
    """Give what effects make of pressures that have long stood still, shape (samples, chambers)."""
    none: tuple[Memory, ...] = ((),) * len(effects)
    return _shape_drive(effects, world, drive, none, list(none)).pressures


def recorded_turn(base_rotation: Floats, effects: Sequence[PlacedEffect]) -> Floats:
    """Give the turn that a recorded base shows at its mean pose, by which the laboratory is found [rad].

    Args:
        base_rotation: Turn of the base along the recording, shape (samples, 3).
        effects: The effects that turn it, some of them beneath what is recorded.

    Returns:
        Shape (3,).
    """
    tilts = [placed.theta for placed in effects if placed.effect.name == "base_tilt"]
    shown: Floats = base_rotation.mean(axis=0) - sum(map(base_tilt.hidden, tilts), np.zeros(3))
    return shown


def _answers(placed: PlacedEffect) -> bool:
    return placed.effect.hook in FIRST_STEP


def signals_of(drive: Drive, world: World, response: Response | None = None) -> Signals:
    """Gather what effects see; without a response, that of an arm at rest at the base."""
    samples = drive.samples
    if response is None:
        strains = np.zeros((samples, len(world.segments), 4))
        positions = np.zeros((samples, len(world.sections), 3))
    else:
        strains, positions = response.strains, response.frames.positions
    force = drive.wrenches[..., :3] + world.masses[:, None] * drive.gravity[:, None, :]
    moment = (np.cross(positions, force) + drive.wrenches[..., 3:]).sum(axis=1)
    return Signals(
        drive.time, drive.pressures, drive.gravity, strains, positions, moment, np.zeros((samples, 0))
    )


def _shape_drive(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    before: tuple[Memory, ...],
    after: list[Memory],
) -> Drive:
    """Let effects act on pressures and gravity."""
    for k, placed in enumerate(effects):
        hook = placed.effect.hook
        if hook == "pressure" or (hook == "command" and not world.pressures_measured):
            pressures, after[k] = placed.act(signals_of(drive, world), before[k])
            drive = replace(drive, pressures=pressures)
        elif hook == "gravity":
            change, after[k] = placed.act(signals_of(drive, world), before[k])
            drive = replace(drive, gravity=drive.gravity + change)
    return drive


def _no_share(placed: PlacedEffect, drive: Drive) -> Floats:
    """No strain, wrench or rotation by an effect, shape (samples, size)."""
    shapes = {"couple": drive.couples, "load": drive.wrenches, "support": drive.base_rotation}
    return np.zeros((drive.samples, shapes[placed.effect.hook][0].size))


def _share(
    placed: PlacedEffect, world: World, drive: Drive, response: Response, own: Floats, before: Memory
) -> tuple[Floats, Memory]:
    """Give what an effect adds in a response that already holds its own share."""
    signals = signals_of(drive, world, response)
    if placed.effect.hook != "couple":
        value, memory = placed.act(signals, before)
        return value.reshape(drive.samples, -1), memory
    free = signals.strains - own.reshape(signals.strains.shape)
    strains, memory = placed.act(replace(signals, strains=free), before)
    return (strains - free).reshape(drive.samples, -1), memory


def _relaxed(gap: Floats, old: tuple[Floats, Floats] | None, first: float) -> Floats:
    """Give the share of each sample's gap to take (Aitken), shape (samples,)."""
    if old is None:
        return np.full(len(gap), first)
    turned = gap - old[0]
    square = (turned**2).sum(axis=1)
    step = -old[1] * (old[0] * turned).sum(axis=1) / np.where(square > 0.0, square, 1.0)
    return np.where(square > 0.0, np.clip(step, SMALLEST_STEP, 2.0), 1.0)


def _loaded(drive: Drive, effects: Sequence[PlacedEffect], shares: dict[int, Floats]) -> Drive:
    """Add the effects' shares to a drive."""
    for k, share in shares.items():
        hook = effects[k].effect.hook
        if hook == "couple":
            drive = drive.strained(share.reshape(drive.free.shape))
        elif hook == "load":
            drive = drive.plus(share.reshape(drive.wrenches.shape), np.zeros_like(drive.couples))
        else:
            drive = replace(drive, base_rotation=drive.base_rotation + share)
    return drive


def _readings(
    effects: Sequence[PlacedEffect],
    world: World,
    drive: Drive,
    response: Response,
    suite: SensorSuite | None,
    before: tuple[Memory, ...],
    after: list[Memory],
) -> dict[str, Floats]:
    """Predict the readings, effects of sensing included."""
    if suite is None:
        return {}
    scene = Scene(response.frames, drive.wrenches.reshape(drive.samples, -1))
    readings = {sensor.name: sensor.predict(scene) for sensor in suite.measurements}
    for k, placed in enumerate(effects):
        if placed.effect.hook == "sensing" and placed.spot.place.sensor in readings:
            name = placed.spot.place.sensor
            signals = replace(signals_of(drive, world, response), reading=readings[name])
            readings[name], after[k] = placed.act(signals, before[k])
    return readings
