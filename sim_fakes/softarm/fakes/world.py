"""The world behind the wires: valves drive the arm, the arm is seen by every instrument."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.errors import InputError
from softarm.fakes.clock import Clock
from softarm.fakes.faults import nearest
from softarm.fakes.plant.state import STAGE_SPEED, Cord, Hand, Plant, PlantInputs, PlantState
from softarm.fakes.valves.node import CpxNode


class FakeArmWorld:
    """Steps the valves and the arm together at a fixed rate.

    Args:
        plant: The arm.
        actuator: The valve terminal; without one every chamber is vented.
        valve_map: Valve of each chamber, shape (chambers,).
        step: Step of the world [s].
    """

    def __init__(
        self, plant: Plant, actuator: CpxNode | None, valve_map: Sequence[int], step: float = 1e-3
    ) -> None:
        self.plant = plant
        self.cord: Cord | None = None
        self._goal: Cord | None = None
        self.hand: Hand | None = None
        self._actuator = actuator
        self._valve_map = np.array(valve_map, dtype=np.int64)
        self.step = step
        self._steps = 0

    @property
    def state(self) -> PlantState:
        """The latest snapshot."""
        return self.plant.state

    @property
    def time(self) -> float:
        """Time up to which the world has been stepped [s]."""
        return self._steps * self.step

    def advance(self, time: float, most: int = 50) -> bool:
        """Step up to ``time`` [s], at most ``most`` steps; return whether it was reached."""
        for _ in range(most):
            if self.time + self.step > time + 1e-9:
                return True
            self._advance_once()
        return self.time + self.step > time + 1e-9

    def tie(self, cord: Cord | None) -> None:
        """Tie the cord of the gauge to a section, or take it off; while it is on, its stage moves it."""
        if cord is not None:
            self._check("cord", cord.section, (*cord.hook, cord.length))
        self._goal = cord
        if cord is None or self.cord is None or cord.section != self.cord.section:
            self.cord = cord

    def hold(self, hand: Hand | None) -> None:
        """Put a hand on a section, or take it away."""
        if hand is not None:
            self._check("hand", hand.section, (*hand.force, *hand.position, hand.stiffness))
        self.hand = hand

    def _check(self, what: str, section: str, numbers: tuple[float, ...]) -> None:
        if section not in self.plant.sections:
            cure = nearest(section, self.plant.sections)
            raise InputError(f"fakes, {what}", f"no section {section!r}", cure)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError(f"fakes, {what}", "a number is not finite", "give finite SI values")

    def _move_stage(self) -> None:
        """Bring the hook nearer to where it shall be; jerked, the cord would set the arm swinging."""
        if self.cord is None or self._goal is None or self.cord == self._goal:
            return
        here, there = np.array(self.cord.hook), np.array(self._goal.hook)
        distance, reach = float(np.linalg.norm(there - here)), STAGE_SPEED * self.step
        if distance <= reach:
            self.cord = self._goal
            return
        x, y, z = (here + reach / distance * (there - here)).tolist()
        self.cord = replace(self._goal, hook=(x, y, z))

    def _advance_once(self) -> None:
        self._steps += 1
        self._move_stage()
        pressures = np.zeros(self.plant.chambers)
        if self._actuator is not None:
            self._actuator.update(self.time)
            pressures = self._actuator.pressures()[self._valve_map]
        self.plant.advance(self.time, PlantInputs(pressures, self.cord, self.hand))


async def run_world(world: FakeArmWorld, clock: Clock, tick: float = 2e-3) -> None:
    """Keep a world at the time of a clock, forever; the loop gets its turn at least every 50 steps."""
    while True:
        # A world that is behind sleeps for no time but gives up the loop: the wires go on meanwhile.
        reached = world.advance(clock.now())
        await clock.sleep_until(world.time + max(tick, world.step) if reached else 0.0)
