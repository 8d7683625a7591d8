"""Density other than described: all weights scale, g -> g (1 + s)."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    everywhere,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Scale gravity."""
    (change,) = theta
    return change * signals.gravity, memory


def modal(theta: Floats) -> ModalChange:
    """Let all masses grow alike."""
    return ModalChange(mass_ratio=1.0 + float(theta[0]))


LIGHTEST = -0.15
"""Silicone rubbers have 970 to 1300 kg/m3, so an arm as drawn is at most so much
lighter."""


EFFECT = Effect(
    name="distributed_mass",
    hook="gravity",
    parameters=(ParameterSpec("change", "1", 0.1, LIGHTEST, 2.0, spread=0.1),),
    places=everywhere,
    act=act,
    statement="The mass of {where} is {change:lower|higher} than in the model.",
    source="Statics",
    equivalence=(
        "weight",
        "uniform_gain",
    ),
    needs=frozenset({"mount_turned"}),
    splits=(("tip_payload", "mount turned, or a known weight on and off"),),
    changes_inertia=True,
    modal=modal,
)
