"""A sensor whose offset grows with the clock, whatever the arm does."""

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import with_offset
from softarm.estimator.effects.world import Spot, sensors


def act(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Offset the reading with the clock."""
    return with_offset(signals.reading, signals.time[:, None] * theta), memory


EFFECT = Effect(
    name="sensor_drift",
    hook="sensing",
    parameters=(
        ParameterSpec("rate_x", "rad/s", 0.0001, -0.01, 0.01, spread=0.0002),
        ParameterSpec("rate_y", "rad/s", 0.0001, -0.01, 0.01, spread=0.0002),
    ),
    places=sensors,
    act=act,
    statement="{where} drifts by {rate_x} in x and {rate_y} in y.",
    source="Kinematics",
    needs=frozenset({"long_run"}),
    splits=(
        ("thermal_drift", "return to zero pressure every few minutes"),
        ("viscoelastic_creep", "two kinds of sensor on one motion"),
    ),
    when="time of the run",
)
