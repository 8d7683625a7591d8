"""Runs one effect on the straight arm under given pressures."""

import numpy as np

from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.effects.simulate import Simulation, simulate_with
from softarm.estimator.sensing import Bend, SensorSuite
from softarm.estimator.simulation import Drive
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import straight_arm, world

SUITE = SensorSuite((Bend("bend_intermediate", 0, 1e-3), Bend("bend_tip", 1, 1e-3)))
WORLD = world(("bend_intermediate", "bend_tip"))


def placed(name: str, theta: list[float] | np.ndarray, **where: str | int) -> PlacedEffect:
    return PlacedEffect(EFFECTS[name], Spot(WORLD, Place(**where)), np.asarray(theta, dtype=float))


def drive_of(time: np.ndarray, pressures: np.ndarray, gravity: tuple[float, ...] = (0, 0, 9.81)) -> Drive:
    return Drive.of(time, pressures, np.array(gravity, dtype=float), 2, 2)


def run(drive: Drive, *effects: PlacedEffect, memories: tuple | None = None) -> Simulation:
    return simulate_with(effects, straight_arm(drive.time), WORLD, drive, SUITE, memories)


def step_drive(samples: int = 200, pressure: float = 2e4, chamber: int = 0, dt: float = 0.5) -> Drive:
    pressures = np.zeros((samples, 6))
    pressures[samples // 10 :, chamber] = pressure
    return drive_of(dt * np.arange(samples), pressures)
