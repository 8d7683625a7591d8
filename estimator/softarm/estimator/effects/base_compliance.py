"""The mount yields: the base turns by C M, M the moment of all weights and loads about it."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    everywhere,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Turn the base with its moment about x and y."""
    (compliance,) = theta
    return compliance * signals.moment * np.array([1.0, 1.0, 0.0]), memory


EFFECT = Effect(
    name="base_compliance",
    hook="support",
    parameters=(ParameterSpec("compliance", "rad/(N m)", 0.05, 0.0, 5.0, spread=0.2),),
    places=everywhere,
    act=act,
    statement="The mount is compliant: it rotates by {compliance} of moment on it.",
    source="Linear elasticity",
    equivalence=("weight",),
    needs=frozenset({"mount_turned"}),
    splits=(
        ("distributed_mass", "markers on the base"),
        ("tip_payload", "markers on the base"),
    ),
    when="pose",
    changes_inertia=True,
)
