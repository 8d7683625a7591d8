"""A mass that the model does not know, fixed to a section: force m g at its origin."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    moving_sections,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Weigh down the section."""
    (mass,) = theta
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    wrenches[:, spot.section, :3] = mass * signals.gravity
    return wrenches, memory


def modal(theta: Floats) -> ModalChange:
    """Add the weight to the modal mass."""
    return ModalChange(added_mass=float(theta[0]))


EFFECT = Effect(
    name="tip_payload",
    hook="load",
    parameters=(ParameterSpec("mass", "kg", 0.02, 0.0, 2.0, spread=0.05),),
    places=moving_sections,
    act=act,
    statement="{where} carries a mass that is not in the model: {mass}.",
    source="Statics",
    equivalence=("weight",),
    needs=frozenset({"mount_turned"}),
    splits=(
        ("distributed_mass", "mount turned, or a known weight on and off"),
        ("base_compliance", "markers on the base"),
    ),
    changes_inertia=True,
    modal=modal,
)
