"""Creep: strain grows after every step of load, and comes back after release.

Kelvin-Voigt element in series with the elastic segment: eps = (1 + i) (u + g z), tau z' = u - z, with u the
elastic strain of the model, g the relaxation strength and tau the retardation time. The stiffness that a
model was calibrated to is that of no single rate, so the part of the strain that is there at once may change
too, by i. The relaxation strength is the delayed over the immediate compliance and equally the modulus of a
Maxwell branch over that of the spring beside it (A. S. Nowick and B. S. Berry, Anelastic Relaxation in
Crystalline Solids, 1972).
"""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.world import Spot, whole_and_segments
from softarm.estimator.simulation.filters import first_order


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Add the delayed strain; an arm that has hung at rest has crept under what it bears at the start."""
    strength, lag, instant = theta
    late, memory = first_order(signals.time, signals.strains, lag, memory)
    changed = (1.0 + instant) * (signals.strains + strength * late)
    share = spot.segments[:, None]
    return (1.0 - share) * signals.strains + share * changed, memory


EFFECT = Effect(
    name="viscoelastic_creep",
    hook="constitutive",
    parameters=(
        ParameterSpec("strength", "1", 0.1, -0.5, 2.0, spread=0.2),
        ParameterSpec("time_constant", "s", 20.0, 0.5, 500.0, "shape", "log", 1.5),
        ParameterSpec("instant_change", "1", 0.05, -0.5, 0.5, spread=0.1, alone=("segment_stiffness", -1.0)),
    ),
    places=whole_and_segments,
    act=act,
    statement="The material of {where} creeps: after a step its strain grows by a further "
    "{strength:percent} of the immediate strain, with a time constant of {time_constant}. The immediate "
    "strain is {instant_change:lower|higher} than in the model.",
    source="W. N. Findley et al., Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976",
    equivalence=("memory_at_one_rate",),
    needs=frozenset({"holds"}),
    splits=(
        ("hysteresis", "ramps at two rates, then holds of three time constants"),
        ("thermal_drift", "repeat the hold after an hour of the same load"),
    ),
    when="time since a change",
    shapes=((0.7,), (2.0,), (6.0,), (20.0,), (60.0,)),
)
