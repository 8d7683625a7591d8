"""A leak behind a restriction: the pressure sinks towards a share of what is supplied.

p = p_in - s z, tau z' = p_in - z, s the share lost in a long hold and tau the time constant.
"""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import (
    Spot,
    whole_and_chambers,
)
from softarm.estimator.simulation.filters import first_order


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Lose a share of each pressure."""
    share, lag = theta
    start = memory or (signals.time[:1], signals.pressures[0], np.zeros_like(signals.pressures[0]))
    lost, memory = first_order(signals.time, signals.pressures, lag, start)
    return signals.pressures - share * spot.chambers * lost, memory


EFFECT = Effect(
    name="line_leak",
    hook="pressure",
    parameters=(
        ParameterSpec("share", "1", 0.1, 0.0, 0.95, spread=0.1),
        ParameterSpec("time_constant", "s", 5.0, 0.1, 500.0, "shape", "log", spread=1.5),
    ),
    places=whole_and_chambers,
    act=act,
    statement="{where} leaks: a held pressure falls by {share:percent} with a time constant of "
    "{time_constant}.",
    source="Two linear restrictions on one volume",
    equivalence=("leak_or_gain",),
    needs=frozenset({"holds"}),
    splits=(
        ("chamber_gain", "close the valve at pressure for 30 s"),
        ("viscoelastic_creep", "compare with measured pressures"),
    ),
    when="pressure level",
    shapes=((0.3,), (3.0,), (30.0,)),
    driven=True,
)
