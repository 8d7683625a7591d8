"""Inertia and damping: strain follows the load like an oscillator, a^2 x'' + d x' + x = u.

a is the inverse of the undamped angular frequency and d the damping time; a = 0 leaves Kelvin-Voigt damping.
One mode for all of the place: vibrations of a few hertz are of the arm's first bending mode.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_segments,
)
from softarm.estimator.simulation.filters import second_order


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Filter the strains of the place."""
    inertia, damping = theta
    moving, memory = second_order(signals.time, signals.strains, inertia, damping, memory)
    return np.where(spot.segments[:, None], moving, signals.strains), memory


EFFECT = Effect(
    name="inertia_damping",
    hook="constitutive",
    parameters=(
        ParameterSpec("inertia_time", "s", 0.02, 0.0, 0.2, spread=0.03),
        ParameterSpec("damping_time", "s", 0.01, 0.0, 2.0, spread=0.1),
    ),
    places=whole_and_segments,
    act=act,
    statement="{where} moves with inertia and damping that the model leaves out: the inverse of its angular "
    "frequency is {inertia_time}, its damping time {damping_time}.",
    source="J. W. Strutt (Rayleigh), The Theory of Sound, 1877",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("line_lag", "release a weight, or compare with measured pressures"),
        ("sensor_latency", "two kinds of sensor on one motion"),
    ),
    when="rate",
)
