"""A sensor with a constant offset in its own axes: added to angles, a small turn of a frame."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import with_offset
from softarm.estimator.effects.world import Spot, sensors


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Offset the reading."""
    return with_offset(signals.reading, theta), memory


EFFECT = Effect(
    name="sensor_bias",
    hook="sensing",
    parameters=(
        ParameterSpec("bias_x", "rad", 0.01, -1.0, 1.0, spread=0.02),
        ParameterSpec("bias_y", "rad", 0.01, -1.0, 1.0, spread=0.02),
    ),
    places=sensors,
    act=act,
    statement="{where} reads with a constant offset of {bias_x} in x and {bias_y} in y.",
    source="Kinematics",
    equivalence=("constant_offset",),
    needs=frozenset({"rest"}),
    splits=(
        ("base_tilt", "mount turned by 90 degrees"),
        ("pressure_bias", "vent, then command small pressures"),
    ),
)
