"""An effect at a place, and the one way in which it acts on what drives the arm."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.effects.effect import Effect, Hook, Memory, Signals
from softarm.estimator.effects.springs import Springs
from softarm.estimator.effects.world import Spot, World
from softarm.estimator.response import ArmResponse
from softarm.estimator.sensing import Bend, Measurement
from softarm.estimator.simulation import Drive

FIELDS: Mapping[Hook, str] = {
    "command": "pressures",
    "pressure": "pressures",
    "gravity": "gravity",
    "load": "wrenches",
    "constitutive": "eigenstrains",
    "support": "base_rotation",
}
"""Part of a ``Drive`` that an effect changes, by its hook; an effect of sensing changes none."""
ANSWERING = frozenset({"wrenches", "eigenstrains", "base_rotation"})
"""Parts that may depend on the arm's response."""
PLACE = 3
"""Entries of a reading that is a place; those of bends and of frames are fewer or more."""


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place, with its parameters.

    Args:
        spot: Where it acts.
        theta: Its parameters, shape (parameters,).
    """

    effect: Effect
    spot: Spot
    theta: Floats

    @property
    def field(self) -> str:
        """Part of a ``Drive`` that it changes; empty for an effect of sensing."""
        return FIELDS.get(self.effect.hook, "")

    @property
    def key(self) -> Hashable:
        """What distinguishes it from other effects in the same world."""
        return self.effect.name, self.spot.place, self.theta.tobytes()

    @property
    def answers(self) -> bool:
        """Whether what it does may depend on the arm's response."""
        return self.field in ANSWERING

    def stiffness(self, clock: Floats) -> Floats | None:
        """Return the factor on the stiffness of its segments along a clock [s], shape (samples,), if any."""
        return None if self.effect.stiffness is None else self.effect.stiffness(clock, self.theta)

    def act(self, signals: Signals, memory: Memory) -> tuple[Floats, Memory]:
        """Run the effect over a stretch of time.

        What changes pressures changes those in the chambers. A calibration gives their effective pressures;
        its curve, whether of the winding or of the rubber, follows the pressure in the chamber.
        """
        actuation = self.spot.world.actuation
        if self.field != "pressures" or actuation is None:
            return self.effect.act(signals, self.theta, self.spot, memory)
        inside = actuation.to_measured(signals.pressures)
        changed, memory = self.effect.act(replace(signals, pressures=inside), self.theta, self.spot, memory)
        return signals.pressures + actuation.to_chamber(changed) - actuation.to_chamber(inside), memory

    def springs(self, signals: Signals) -> Springs:
        """Return the springs on one side that the effect consists of, of which it must have some."""
        assert self.effect.springs is not None
        return self.effect.springs(signals, self.theta, self.spot)

    def misread(
        self, signals: Signals, sensor: Measurement, reading: Floats, memory: Memory = ()
    ) -> tuple[Floats, Memory]:
        """Return readings of a sensor, shape (samples, entries), as an effect of sensing changes them.

        What a bend sensor has for an offset is the output of its electronics, which neither turns with its
        mount nor grows with its scale factor. The place of a marker changes in base axes: what is found must
        not depend on how somebody laid the laboratory's axes.
        """
        if isinstance(sensor, Bend):
            changed, memory = self.act(replace(signals, reading=reading - sensor.bias), memory)
            return changed + sensor.bias, memory
        laboratory = sensor.registration if reading.shape[-1] == PLACE else None
        if laboratory is None:
            return self.act(replace(signals, reading=reading), memory)
        changed, memory = self.act(replace(signals, reading=laboratory.to_base(reading)), memory)
        return laboratory.to_laboratory(changed), memory

    def change(self, signals: Signals, memory: Memory = ()) -> tuple[Floats, Memory]:
        """Compute what the effect adds to its part of the drive, and its memory after the last sample.

        An effect on pressures or on the material returns the new value; the others return their share.
        """
        value, memory = self.act(signals, memory)
        if self.field == "pressures":
            return value - signals.pressures, memory
        if self.field == "eigenstrains":
            return value - signals.strains, memory
        return value, memory

    def apply(self, drive: Drive, change: Floats) -> Drive:
        """Add a change to the effect's part of a drive."""
        before: Floats = getattr(drive, self.field)
        after: dict[str, Any] = {self.field: before + change.reshape(before.shape)}
        return replace(drive, **after)


def signals_of(drive: Drive, world: World, response: ArmResponse | None = None) -> Signals:
    """Gather what effects see; without a response, that of an arm at rest at the base."""
    samples = drive.samples
    if response is None:
        strains = np.zeros((samples, len(world.segments), 4))
        positions = np.zeros((samples, len(world.sections), 3))
        rotations = np.broadcast_to(np.eye(3), (*positions.shape, 3))
    else:
        strains = response.strains
        positions, rotations = response.frames.positions, response.frames.rotations
    loads = (np.cross(positions, drive.wrenches[..., :3]) + drive.wrenches[..., 3:]).sum(axis=1)
    moment = loads + np.cross(world.first_moment(positions, rotations), drive.gravity)
    return Signals(
        drive.time,
        drive.pressures,
        drive.gravity,
        strains,
        positions,
        rotations,
        moment,
        np.zeros((samples, 0)),
    )


def met(effects: Sequence[PlacedEffect], signals: Signals) -> Indices:
    """Return the numbers of the samples at which walls and cords act, for their loads have no memory."""
    loads = [placed.act(signals, ())[0] for placed in effects]
    return np.flatnonzero(np.abs(loads).max(axis=(0, 2, 3)))
