"""Running a manoeuvre on a fake arm: the truth, before any sensor."""

from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.manoeuvre import SAMPLE, CordPull, Grip, PlantManoeuvre
from softarm.fakes.plant.state import Cord, Hand, PlantInputs, PlantState


@dataclass(frozen=True)
class Truth:
    """What really happened, sampled at 100 Hz.

    Args:
        time: [s], shape (samples,).
        outlets: Pressures at the valves' outlets [Pa], shape (samples, chambers).
        chambers: Pressures in the chambers [Pa], shape (samples, chambers).
        poses: Position and quaternion of the sections in the laboratory frame, shape (samples, sections, 7).
        cord_force: [N], shape (samples,).
        hook: Position of the gauge's hook in the laboratory frame [m], NaN while no cord is tied, shape
            (samples, 3).
        forces: External force on each section, laboratory frame [N], shape (samples, sections, 3).
        sections: Names of the sections.
    """

    time: Floats
    outlets: Floats
    chambers: Floats
    poses: Floats
    cord_force: Floats
    hook: Floats
    forces: Floats
    sections: tuple[str, ...]


Event = TypeVar("Event", CordPull, Grip)


@dataclass(frozen=True)
class _Track(Generic[Event]):
    """Pulls or grips, and where the section of each was when it began."""

    events: tuple[Event, ...]
    sections: tuple[str, ...]
    origins: dict[int, Floats] = field(default_factory=dict)

    def at(self, sample: int, state: PlantState) -> tuple[Event, Floats, int] | None:
        """Return the event of a sample, the section's position at its start [m], and the samples since."""
        for event in self.events:
            since = sample - event.start
            if 0 <= since < event.samples:
                place = state.positions[self.sections.index(event.section)]
                return event, self.origins.setdefault(event.start, place.copy()), since
        return None


def perform(arm: FakeArm, manoeuvre: PlantManoeuvre, outlets: Floats) -> Truth:
    """Run a manoeuvre.

    Args:
        arm: Goes on from its state; its time moves on by the manoeuvre's duration.
        manoeuvre: Pulls and grips; its commands are not looked at.
        outlets: Pressures at the valves' outlets [Pa], shape (samples, chambers).
    """
    pulls = _Track(manoeuvre.pulls, arm.sections)
    grips = _Track(manoeuvre.grips, arm.sections)
    start, count = arm.state.time, len(outlets)
    states: list[PlantState] = []
    hooks = np.full((count, 3), np.nan)
    before = outlets[0]
    for index, pressures in enumerate(outlets):
        cord, hand = _cord(pulls, index, arm.state), _hand(grips, index, arm.state)
        arm.advance(start + (index + 1) * SAMPLE, PlantInputs(0.5 * (before + pressures), cord, hand))
        states.append(arm.state)
        before = pressures
        if cord is not None:
            hooks[index] = cord.hook
    return Truth(
        time=np.array([state.time for state in states]),
        outlets=outlets,
        chambers=np.array([state.chamber_pressures for state in states]),
        poses=np.array([np.column_stack([state.positions, state.quaternions]) for state in states]),
        cord_force=np.array([state.cord_force for state in states]),
        hook=hooks,
        forces=np.array([state.external_forces for state in states]),
        sections=arm.sections,
    )


def _cord(pulls: _Track[CordPull], sample: int, state: PlantState) -> Cord | None:
    """Return the cord that is tied at a sample, if any."""
    hold = pulls.at(sample, state)
    if hold is None:
        return None
    pull, knot, since = hold
    direction = np.array(pull.direction) / np.linalg.norm(pull.direction)
    hook = knot + (pull.length - pull.slack + pull.travel[since]) * direction
    return Cord(pull.section, (float(hook[0]), float(hook[1]), float(hook[2])), pull.length)


def _hand(grips: _Track[Grip], sample: int, state: PlantState) -> Hand | None:
    """Return the hand that holds a section at a sample, if any."""
    hold = grips.at(sample, state)
    if hold is None:
        return None
    grip, place, since = hold
    target = place + grip.path[since]
    position = (float(target[0]), float(target[1]), float(target[2]))
    return Hand(grip.section, position=position, stiffness=grip.stiffness)
