"""Stiffness of a segment other than described: eps = u / (1 + e), whatever causes the load."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    segments,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the strains of the segment."""
    (change,) = theta
    return signals.strains / (1.0 + change * spot.segments[:, None]), memory


def modal(theta: Floats) -> ModalChange:
    """Change the stiffness."""
    return ModalChange(stiffness_ratio=1.0 + float(theta[0]))


EFFECT = Effect(
    name="segment_stiffness",
    hook="constitutive",
    parameters=(ParameterSpec("change", "1", 0.1, -0.8, 4.0, spread=0.2),),
    places=segments,
    act=act,
    statement="The stiffness of {where} is {change:lower|higher} than in the model.",
    source="Linear elasticity",
    equivalence=("uniform_gain",),
    needs=frozenset({"motion"}),
    splits=(("chamber_gain", "a known weight on and off"),),
    when="pose",
    modal=modal,
)
