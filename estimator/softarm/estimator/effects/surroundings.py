"""Effects of what the arm hangs on, carries and touches."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.effects.effect import Effect, Memory, ModalChange, ParameterSpec, Signals
from softarm.estimator.effects.springs import Springs
from softarm.estimator.effects.surface import POINTS
from softarm.estimator.effects.world import AROUND, Spot, everywhere, moving_sections
from softarm.estimator.rotations import exp

TINY = 1e-9
"""Horizontal share of gravity below which the arm hangs, or stands."""


def base_compliance(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Rotate a compliant mount by C M about x and y, M the moment of weights and loads about the base.

    That is where it rests: how it gets there, shows where the model vibrates.
    """
    compliance, _ = theta
    return compliance * signals.moment * np.array([1.0, 1.0, 0.0]), memory


def base_compliance_modal(theta: Floats) -> ModalChange:
    """Let the mount yield while the arm vibrates, too, and damp what it does."""
    compliance, damping_time = theta.tolist()
    return ModalChange(base_compliance=compliance, base_damping_time=damping_time)


BASE_COMPLIANCE = Effect(
    name="base_compliance",
    hook="support",
    parameters=(
        ParameterSpec("compliance", "rad/(N m)", 0.05, 0.0, 5.0, spread=0.2),
        ParameterSpec("damping_time", "s", 0.05, 0.001, 5.0, "shape", "log", spread=2.0),
    ),
    places=everywhere,
    act=base_compliance,
    statement="The mount is compliant: it rotates by {compliance} of moment on it, with a damping time of "
    "{damping_time}.",
    source="Kelvin and Voigt: a linear spring beside a linear damper",
    equivalence=("weight",),
    needs=frozenset({"mount_turned"}),
    splits=(("distributed_mass", "markers on the base"), ("tip_payload", "markers on the base")),
    when="pose",
    shapes=((0.01,), (0.5,)),
    changes_inertia=True,
    modal=base_compliance_modal,
)


def base_tilt(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:  # noqa: ARG001
    """Rotate the base by a constant angle about its x and y axes, gravity staying where it is.

    Where the recording shows the base, part of the rotation may lie beneath what is seen: all of it where the
    clamp sits askew in its mount, none where the mount itself is rotated.
    """
    return np.tile(np.append(theta[:2], 0.0), (len(signals.time), 1)), memory


def hidden_tilt(theta: Floats) -> Floats:
    """Return the rotation that the recorded base does not show [rad], shape (3,)."""
    tilt_x, tilt_y, beneath = theta.tolist()
    return np.array([beneath * tilt_x, beneath * tilt_y, 0.0])


BASE_TILT = Effect(
    name="base_tilt",
    hook="support",
    parameters=(
        ParameterSpec("tilt_x", "rad", 0.05, -0.6, 0.6, spread=0.05),
        ParameterSpec("tilt_y", "rad", 0.05, -0.6, 0.6, spread=0.05),
        ParameterSpec("beneath", "1", 0.5, 0.0, 1.0, "shape", spread=1.0),
    ),
    places=everywhere,
    act=base_tilt,
    statement="The base is tilted relative to the model, by {tilt_x} about x and {tilt_y} about y.",
    source="Kinematics",
    equivalence=("constant_offset",),
    needs=frozenset({"mount_turned"}),
    splits=(("sensor_bias", "mount turned by 90 degrees"),),
    shapes=((0.0,), (1.0,)),
    hidden_rotation=hidden_tilt,
)


SOFTEST = 25.0
"""Stiffness [N/m] below which what holds a section back is no obstacle: of all points of a segment."""
LEAST_CORD = 1e-6
"""Length of a cord [m] below which it has no direction."""


def wall_springs(signals: Signals, theta: Floats, spot: Spot) -> Springs:
    """Push the arm back from a wall beside it: f = -k max(n . x + r - r_s - d, 0) n.

    n = (cos a, sin a, 0) points into the wall. The arm touches it with its surface, r from the axis, at some
    points of its length down to a section: first there, as a rule. d is how far the wall is from that
    section's surface at rest, r_s from its axis.
    """
    stiffness, distance, azimuth = theta
    normal, surface = np.array([np.cos(azimuth), np.sin(azimuth), 0.0]), spot.world.surface
    touching = surface.down_to(spot.section)
    wider = touching.radii - surface.section_radii[spot.section]
    reach = touching.points(signals.positions, signals.rotations) @ normal + wider
    gradients = touching.gradients(signals.rotations, normal)
    return Springs(np.full(len(wider), stiffness), reach - distance, gradients)


def contact_obstacle(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Return the wrenches of a wall in these poses; see ``wall_springs``."""
    springs = wall_springs(signals, theta, spot)
    return springs.wrenches(springs.forces), memory


CONTACT_OBSTACLE = Effect(
    name="contact_obstacle",
    hook="load",
    parameters=(
        ParameterSpec("stiffness", "N/m", 30.0, SOFTEST / POINTS, 5000.0, transform="inverse", spread=100.0),
        ParameterSpec("distance", "m", 0.01, -0.5, 0.5, "shape", "linear", spread=0.1),
        ParameterSpec(
            "azimuth", "rad", 0.0, -3.141592653589793, 3.141592653589793, "shape", "linear", spread=2.0
        ),
    ),
    places=moving_sections,
    act=contact_obstacle,
    statement="An obstacle pushes {where} back: it starts {distance} from the rest position in the "
    "direction of {azimuth} and has a stiffness of {stiffness}.",
    source="Penalty contact with a half space",
    in_healthy_arms=False,
    needs=frozenset({"each_chamber"}),
    splits=(
        ("material_stiffening", "reach one pose by different chambers"),
        ("tether_stiffness", "the opposite side of the workspace"),
    ),
    when="pose",
    shapes=tuple((distance, angle) for distance in (0.01, 0.03, 0.05, 0.07) for angle in AROUND),
    springs=wall_springs,
)


def external_force(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Push a section with a constant force of unknown origin, fixed to the base or in the laboratory.

    A weight that pulls over a pulley stays as it is where the mount is turned; in axes of the base it turns.
    """
    *force, laboratory = theta.tolist()
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    turned = _turns(signals.gravity) if laboratory else np.eye(3)
    wrenches[:, spot.section, :3] = turned @ np.array(force)
    return wrenches, memory


def _turns(gravity: Floats) -> Floats:
    """Return by how much the laboratory is turned, in base axes, since the arm hung, shape (samples, 3, 3).

    Gravity, shape (samples, 3), determines all of it but a rotation of the mount about the vertical, which is
    assumed to be none.
    """
    x, y, z = (gravity / np.maximum(np.linalg.norm(gravity, axis=1, keepdims=True), TINY)).T
    level = np.hypot(x, y)
    axis = np.stack([-y, x, np.zeros_like(x)], axis=-1) / np.maximum(level, TINY)[:, None]
    axis[level < TINY] = 1.0, 0.0, 0.0  # any level one
    return exp(axis * np.arctan2(level, z)[:, None])


ALONG = 0.2
"""Lateral share of a force up to which it acts along the arm."""


def along_arm(theta: Floats) -> bool:
    """Return whether the force only stretches the arm."""
    x, y, z, _ = theta.tolist()
    return bool(np.hypot(x, y) < ALONG * abs(z))


EXTERNAL_FORCE = Effect(
    name="external_force",
    hook="load",
    parameters=(
        ParameterSpec("force_x", "N", 0.05, -20.0, 20.0, spread=0.2),
        ParameterSpec("force_y", "N", 0.05, -20.0, 20.0, spread=0.2),
        ParameterSpec("force_z", "N", 0.05, -20.0, 20.0, spread=0.2),
        ParameterSpec("laboratory", "1", 0.0, 0.0, 1.0, "shape", choices=(0.0, 1.0)),
    ),
    places=moving_sections,
    act=external_force,
    statement="A constant force acts on {where}: ({force_x:number}, {force_y:number}, {force_z:number}) N "
    "along x, y and z of the base{laboratory:=, with which it turns| as it hangs, and stays so where the "
    "mount is turned}.",
    source="Statics",
    needs=frozenset({"motion"}),
    splits=(("tip_payload", "mount turned"), ("contact_obstacle", "reach one pose by different chambers")),
    along_arm=along_arm,
    shapes=((0.0,), (1.0,)),
)


def cord_springs(signals: Signals, theta: Floats, spot: Spot) -> Springs:
    """Pull a section to the point to which a cord or hoses tie it: f = k max(|c| - r - l, 0) c / |c|.

    c leads from the section's origin to that point, which lies at the distance r from where the origin is at
    rest, in the direction (cos a, sin a, 0). l is the slack while the arm hangs straight, negative for a cord
    that is stretched then. A cord is soft where an obstacle is hard: what holds back with less than
    ``SOFTEST`` is a cord.
    """
    stiffness, slack, azimuth, reach = theta
    tied = spot.world.origins[spot.section] + reach * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    cord = tied - signals.positions[:, spot.section]
    length = np.maximum(np.linalg.norm(cord, axis=1, keepdims=True), LEAST_CORD)
    gradients = np.zeros((len(cord), 1, len(spot.world.sections), 6))
    gradients[:, 0, spot.section, :3] = -cord / length
    return Springs(np.array([stiffness]), length - reach - slack, gradients)


def tether_stiffness(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Return the wrenches of a cord in these poses; see ``cord_springs``."""
    springs = cord_springs(signals, theta, spot)
    return springs.wrenches(springs.forces), memory


REACH = 0.5
"""Distance [m] at which a cord may be tied: about the size of the arm."""


TETHER_STIFFNESS = Effect(
    name="tether_stiffness",
    hook="load",
    parameters=(
        ParameterSpec("stiffness", "N/m", 5.0, 0.0, SOFTEST, spread=20.0),
        ParameterSpec("slack", "m", 0.01, -0.1, 0.5, "shape", "linear", spread=0.05),
        ParameterSpec("azimuth", "rad", 0.0, -np.pi, np.pi, "shape", "linear", spread=2.0),
        ParameterSpec("reach", "m", REACH, 0.05, 50.0, "shape", "log", spread=1.0),
    ),
    places=moving_sections,
    act=tether_stiffness,
    statement="Hoses or a cord tie {where} to a point {reach} away in the direction of {azimuth}: with "
    "{slack:of stretch|of slack} while the arm hangs straight, they pull with {stiffness} once taut.",
    source="Unilateral spring",
    in_healthy_arms=False,
    needs=frozenset({"large_pressures"}),
    splits=(
        ("material_stiffening", "loosen the hoses and repeat"),
        ("contact_obstacle", "the opposite side of the workspace"),
    ),
    when="pose",
    shapes=tuple((slack, angle, REACH) for slack in (0.0, 0.02, 0.04) for angle in AROUND),
    springs=cord_springs,
)


def tip_payload(signals: Signals, theta: Floats, spot: Spot, memory: Memory) -> tuple[Floats, Memory]:
    """Weigh a section down by a mass that the model does not know: force m g at its origin."""
    (mass,) = theta
    wrenches = np.zeros((len(signals.time), len(spot.world.sections), 6))
    wrenches[:, spot.section, :3] = mass * signals.gravity
    return wrenches, memory


def tip_payload_modal(theta: Floats) -> ModalChange:
    """Add the weight to the modal mass."""
    return ModalChange(added_mass=float(theta[0]))


TIP_PAYLOAD = Effect(
    name="tip_payload",
    hook="load",
    parameters=(ParameterSpec("mass", "kg", 0.02, 0.0, 2.0, spread=0.05),),
    places=moving_sections,
    act=tip_payload,
    statement="{where} carries a mass that is not in the model: {mass}.",
    source="Statics",
    equivalence=("weight",),
    needs=frozenset({"mount_turned"}),
    splits=(
        ("distributed_mass", "mount turned, or a known weight on and off"),
        ("base_compliance", "markers on the base"),
    ),
    changes_inertia=True,
    modal=tip_payload_modal,
)
