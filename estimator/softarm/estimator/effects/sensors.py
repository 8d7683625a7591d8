"""Effects of the sensors: what becomes of a reading."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ParameterSpec, Signals
from softarm.estimator.effects.readings import QUATERNION, has_orientation, with_offset
from softarm.estimator.effects.world import Spot, sensors
from softarm.estimator.rotations import exp, from_quaternions, log, to_quaternions

BEND = 2  # entries of a reading of two bend angles


def frame_misalignment(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Rotate the reading about the arm's axis: two bend axes, or a frame. Move a single marker along it."""
    (yaw,) = theta
    if signals.reading.shape[-1] == BEND:
        rotation = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return signals.reading @ rotation.T, memory
    return with_offset(signals.reading, np.array([0.0, 0.0, yaw])), memory


FRAME_MISALIGNMENT = Effect(
    name="frame_misalignment",
    hook="sensing",
    parameters=(ParameterSpec("yaw", "rad", 0.05, -1.6, 1.6, spread=0.1, of_marker="offset_z"),),
    places=sensors,
    act=frame_misalignment,
    statement="{where} is mounted {yaw} off about the axis of the arm.",
    marker_statement="{where} is mounted {yaw} off along the axis of the arm.",
    source="Kinematics",
    needs=frozenset({"each_chamber"}),
    splits=(
        ("fibre_twist", "bends in two azimuths at one sum of pressures"),
        ("chamber_crosstalk", "each chamber alone, mount turned"),
    ),
    when="pose",
)


def sensor_bias(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Offset the reading in the sensor's own axes: angles by a constant, a frame by a small rotation."""
    return with_offset(signals.reading, theta), memory


SENSOR_BIAS = Effect(
    name="sensor_bias",
    hook="sensing",
    parameters=(
        ParameterSpec("bias_x", "rad", 0.01, -1.0, 1.0, spread=0.02),
        ParameterSpec("bias_y", "rad", 0.01, -1.0, 1.0, spread=0.02),
    ),
    places=sensors,
    act=sensor_bias,
    statement="{where} reads with a constant offset of {bias_x} in x and {bias_y} in y.",
    source="Kinematics",
    equivalence=("constant_offset",),
    needs=frozenset({"rest"}),
    splits=(
        ("base_tilt", "mount turned by 90 degrees"),
        ("pressure_bias", "vent, then command small pressures"),
    ),
)


def sensor_drift(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Offset the reading with the clock, whatever the arm does."""
    return with_offset(signals.reading, signals.time[:, None] * theta), memory


SENSOR_DRIFT = Effect(
    name="sensor_drift",
    hook="sensing",
    parameters=(
        ParameterSpec("rate_x", "rad/s", 0.0001, -0.01, 0.01, spread=0.0002),
        ParameterSpec("rate_y", "rad/s", 0.0001, -0.01, 0.01, spread=0.0002),
    ),
    places=sensors,
    act=sensor_drift,
    statement="{where} drifts by {rate_x} in x and {rate_y} in y.",
    source="Kinematics",
    needs=frozenset({"long_run"}),
    splits=(
        ("thermal_drift", "return to zero pressure every few minutes"),
        ("viscoelastic_creep", "two kinds of sensor on one motion"),
    ),
    when="time of the run",
)


LONGEST = 1.0  # s, the upper bound of the delay


def sensor_latency(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Delay the reading: y(t) -> y(t - delay), straight between samples.

    Of a frame both place and orientation are late; between samples its quaternion goes straight, with its
    sign kept, and is brought back to unit length.
    """
    (delay,) = theta
    times, values = memory or (signals.time[:1] - LONGEST, signals.reading[:1])
    times, values = np.concatenate([times, signals.time]), np.concatenate([values, signals.reading])
    if has_orientation(signals.reading):
        values = np.concatenate([values[:, :-QUATERNION], _unflipped(values[:, -QUATERNION:])], axis=-1)
    late = np.stack([np.interp(signals.time - delay, times, column) for column in values.T], axis=-1)
    if has_orientation(signals.reading):
        late[:, -QUATERNION:] /= np.linalg.norm(late[:, -QUATERNION:], axis=-1, keepdims=True)
    recent = max(int(np.searchsorted(times, times[-1] - LONGEST)) - 1, 0)
    return late, (times[recent:], values[recent:])


def _unflipped(quaternions: Floats) -> Floats:
    """Return the quaternions of the same rotations without a jump from q to -q, shape (samples, 4)."""
    flips = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=-1) < 0.0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(flips)])
    unflipped: Floats = quaternions * signs[:, None]
    return unflipped


SENSOR_LATENCY = Effect(
    name="sensor_latency",
    hook="sensing",
    parameters=(ParameterSpec("delay", "s", 0.1, 0.0, 1.0, spread=0.1),),
    places=sensors,
    act=sensor_latency,
    statement="{where} reports its readings {delay} late.",
    source="Transport delay",
    equivalence=("delay",),
    needs=frozenset({"pressure_steps"}),
    splits=(
        ("line_lag", "compare with measured pressures"),
        ("inertia_damping", "two kinds of sensor on one motion"),
    ),
    when="rate",
)


def sensor_scale(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Scale the reading: y -> (1 + s) y.

    The displacement and the rotation of a frame from its first pose are both scaled.
    """
    factor, reading = 1.0 + theta[0], signals.reading
    if not has_orientation(reading):
        return factor * reading, memory
    (first,) = memory or (reading[0],)
    rest = from_quaternions(first[-QUATERNION:])
    rotation_vectors = log(rest.T @ from_quaternions(reading[:, -QUATERNION:]))
    place = first[:-QUATERNION] + factor * (reading[:, :-QUATERNION] - first[:-QUATERNION])
    return np.concatenate([place, to_quaternions(rest @ exp(factor * rotation_vectors))], axis=-1), (first,)


SENSOR_SCALE = Effect(
    name="sensor_scale",
    hook="sensing",
    parameters=(ParameterSpec("scale", "1", 0.05, -0.9, 2.0, spread=0.1),),
    places=sensors,
    act=sensor_scale,
    statement="{where} reads {scale:too low|too high}.",
    source="Kinematics",
    equivalence=("crosstalk_or_scale",),
    needs=frozenset({"motion"}),
    splits=(
        ("chamber_crosstalk", "drive the lower segment alone, mount turned"),
        ("segment_stiffness", "two kinds of sensor on one motion"),
    ),
    when="pose",
)


def sensor_stuck(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Hold a share of the reading from some time on."""
    share, since = theta
    held = memory[0] if memory else signals.reading[0]
    stopped = signals.time >= since
    before = signals.reading[~stopped]
    held = before[-1] if len(before) else held
    kept = (1.0 - share) * signals.reading + share * held
    return np.where(stopped[:, None] & (share > 0.0), kept, signals.reading), (held,)


SENSOR_STUCK = Effect(
    name="sensor_stuck",
    hook="sensing",
    parameters=(
        ParameterSpec("share", "1", 1.0, 0.0, 1.0, spread=0.5),
        ParameterSpec("since", "s", 0.1, 0.0, 100000.0, "shape", "linear", spread=1000.0),
    ),
    places=sensors,
    act=sensor_stuck,
    statement="{where} is stuck from {since} on: {share:percent} of its reading no longer follows the arm.",
    source="Fault model of stuck sensors",
    needs=frozenset({"motion"}),
    splits=(("sensor_scale", "move the arm after a rest"),),
    when="time of the run",
    by_fit=False,
    hides_reading=True,
)
