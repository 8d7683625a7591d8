"""A chamber acts more or less than described: p -> (1 + g) p."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Scale the pressures."""
    (gain,) = theta
    return signals.pressures * (1.0 + gain * spot.chambers), memory


EFFECT = Effect(
    name="chamber_gain",
    hook="pressure",
    parameters=(ParameterSpec("gain", "1", 0.08, -0.9, 2.0, spread=0.1),),
    places=whole_and_chambers,
    act=act,
    statement="Pressure in {where} has {gain:less|more} effect than in the model.",
    source="Virtual work of a pressure",
    equivalence=(
        "uniform_gain",
        "leak_or_gain",
    ),
    needs=frozenset({"each_chamber"}),
    splits=(
        ("local_stiffness_defect", "bend the arm by gravity, mount turned"),
        ("line_leak", "close the valve at pressure for 30 s"),
    ),
    when="pressure level",
    driven=True,
)
