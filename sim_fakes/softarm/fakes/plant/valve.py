"""The valves of an offline run: dead time, limited rate, first-order approach, a steady error.

The figures are read off the recorded steps of the lab's terminal: 40 to 60 ms dead time, about 29 of 30 kPa
reached in half a second, vented in 0.15 s, -0.5 to -0.9 kPa steady error.
"""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects import Filter
from softarm.fakes.plant.manoeuvre import SAMPLE


@dataclass(frozen=True)
class ValveConstants:
    """Constants of the valves.

    Args:
        dead_time: From set-point to motion [s], shape (chambers,).
        rise_time: Time constant of filling [s].
        fall_time: Time constant of venting [s].
        rise: Fastest filling [Pa/s].
        fall: Fastest venting [Pa/s].
        error: Outlet pressure minus set-point when not vented [Pa], shape (chambers,).
    """

    dead_time: Floats
    rise_time: float = 0.07
    fall_time: float = 0.045
    rise: float = 250e3
    fall: float = 400e3
    error: Floats | float = 0.0


def draw_valve(rng: np.random.Generator, chambers: int) -> ValveConstants:
    """Draw the valves of one terminal."""
    return ValveConstants(rng.uniform(0.04, 0.06, chambers), error=-rng.uniform(0.4e3, 0.9e3, chambers))


def outlet(valve: ValveConstants, commands: Floats, filters: tuple[Filter, ...]) -> Floats:
    """Return the pressures at the outlets [Pa] for commands at 100 Hz, both of shape (samples, chambers).

    Args:
        valve: Constants.
        commands: Set-points [Pa].
        filters: Concealed effects, applied to the set-points in order.
    """
    late = np.empty_like(commands)
    for chamber, delay in enumerate(np.broadcast_to(valve.dead_time, commands.shape[1])):
        clock = np.arange(len(commands)) - delay / SAMPLE
        late[:, chamber] = np.interp(clock, np.arange(len(commands)), commands[:, chamber])
    output = np.empty_like(commands)
    now = np.zeros(commands.shape[1])
    for index, command in enumerate(late):
        target = np.where(command > 0.0, np.maximum(0.0, command + valve.error), 0.0)
        for one in filters:
            target = one.update(index * SAMPLE, target)
        error = target - now
        share = -np.expm1(-SAMPLE / np.where(error > 0.0, valve.rise_time, valve.fall_time))
        now = now + np.clip(share * error, -valve.fall * SAMPLE, valve.rise * SAMPLE)
        output[index] = now
    return output
