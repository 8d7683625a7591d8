"""What Foxglove draws of a recording: section frames, the arm's surface and forces, in its own schemas.

Frames are named as follows. ``base`` is the arm's base; the estimated sections are its children, under their
own names. ``laboratory`` is the frame of the motion capture; the measured sections are its children, under
``measured/<section>``. Where the base is measured, ``base`` is drawn there.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from softarm.estimator.recording import POSE_SUFFIXES

FRAMES, SCENE = "/frames", "/scene"
"""Topics of the frames and of the scene."""
BASE, LABORATORY, MEASURED = "base", "laboratory", "measured/"
METRES_PER_NEWTON = 0.15
SHAFT_M, HEAD_M, HEAD_LENGTH_M = 0.004, 0.01, 0.012
"""Diameters of the arrow of a force, and the length of its head."""
FORCE_COLOUR = (0.94, 0.67, 0.16, 1.0)
SURFACE_COLOUR = (0.45, 0.6, 0.75, 0.6)
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class Frame:
    """A frame in its parent.

    Args:
        position: Origin [m], shape (3,).
        quaternion: Orientation (w, x, y, z), shape (4,).
    """

    name: str
    position: Sequence[float]
    quaternion: Sequence[float]


@dataclass(frozen=True)
class Force:
    """A force on a section.

    Args:
        section: The section's name.
        position: Where it acts, in the base frame [m], shape (3,).
        force: In the base frame [N], shape (3,).
    """

    section: str
    position: Sequence[float]
    force: Sequence[float]


def estimated(values: Mapping[str, float]) -> tuple[list[Frame], list[Force]]:
    """Return the sections that an estimate places, the base aside, and the forces on them.

    Args:
        values: What the stream ``estimate`` holds at one time, by name; what is lost is not in it.
    """
    frames, forces = [], []
    for last in (name for name in values if name.startswith("frame_") and name.endswith("_qz")):
        section = last.removeprefix("frame_").removesuffix("_qz")
        pose = [values[f"frame_{section}_{suffix}"] for suffix in POSE_SUFFIXES]
        if section != BASE:
            frames.append(Frame(section, pose[:3], pose[3:]))
        force = {axis: values.get(f"force_{section}_{axis}_n") for axis in "xyz"}
        if any(component is not None for component in force.values()):
            forces.append(Force(section, pose[:3], [component or 0.0 for component in force.values()]))
    return frames, forces


def frame_transforms(unix_ns: int, parent: str, frames: Iterable[Frame]) -> FrameTransforms:
    """Write frames as ``foxglove.FrameTransforms``.

    Args:
        unix_ns: Wall-clock time [ns].
        parent: Frame in which they are given.
        frames: The frames.
    """
    transforms = FrameTransforms()
    for frame in frames:
        transforms.transforms.append(_transform(unix_ns, parent, frame))
    return transforms


def measured_transforms(unix_ns: int, section: str, pose: Sequence[float]) -> FrameTransforms:
    """Write the measured frame of a section; with that of the base, the base of the estimates.

    Args:
        unix_ns: Wall-clock time [ns].
        section: Name of the section.
        pose: Position [m] and quaternion (w, x, y, z), shape (7,).
    """
    name = MEASURED + section
    transforms = frame_transforms(unix_ns, LABORATORY, [Frame(name, pose[:3], pose[3:])])
    if section == BASE:
        here = Frame(BASE, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        transforms.transforms.append(_transform(unix_ns, name, here))
    return transforms


def force_scene(unix_ns: int, forces: Iterable[Force]) -> SceneUpdate:
    """Draw forces as arrows, 0.15 m a newton, as ``foxglove.SceneUpdate``."""
    update = SceneUpdate()
    for force in forces:
        entity = _entity(unix_ns, f"force/{force.section}")
        entity.arrows.append(_arrow(force))
        update.entities.append(entity)
    return update


def surface_scene(
    unix_ns: int, nodes: NDArray[np.float32], triangles: Sequence[Sequence[int]]
) -> SceneUpdate:
    """Draw the arm's surface as ``foxglove.SceneUpdate``.

    Args:
        unix_ns: Wall-clock time [ns].
        nodes: Positions in the base frame [m], shape (nodes, 3).
        triangles: Corners of each triangle as places in ``nodes``, shape (triangles, 3).
    """
    points = [Point3(x=x, y=y, z=z) for x, y, z in nodes.tolist()]
    surface = TriangleListPrimitive(
        points=points, color=_colour(SURFACE_COLOUR), indices=np.ravel(triangles).tolist()
    )
    surface.pose.orientation.w = 1.0
    entity = _entity(unix_ns, "surface")
    entity.triangles.append(surface)
    return SceneUpdate(entities=[entity])


def _transform(unix_ns: int, parent: str, frame: Frame) -> FrameTransform:
    transform = FrameTransform(timestamp=_time(unix_ns), parent_frame_id=parent, child_frame_id=frame.name)
    _fill(transform.translation, "xyz", frame.position)
    _fill(transform.rotation, "wxyz", frame.quaternion)
    return transform


def _entity(unix_ns: int, name: str) -> SceneEntity:
    return SceneEntity(timestamp=_time(unix_ns), frame_id=BASE, id=name)


def _arrow(force: Force) -> ArrowPrimitive:
    """Draw a force; the arrow of Foxglove points along the x axis of its pose."""
    size = float(np.linalg.norm(force.force))
    direction = np.asarray(force.force) / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    rotation, _ = Rotation.align_vectors(direction[None], np.array([[1.0, 0.0, 0.0]]))
    arrow = ArrowPrimitive(
        shaft_length=METRES_PER_NEWTON * size,
        shaft_diameter=SHAFT_M,
        head_diameter=HEAD_M,
        head_length=HEAD_LENGTH_M,
        color=_colour(FORCE_COLOUR),
    )
    _fill(arrow.pose.position, "xyz", force.position)
    _fill(arrow.pose.orientation, "xyzw", rotation.as_quat())
    return arrow


def _fill(message: object, fields: str, values: Sequence[float]) -> None:
    for field, value in zip(fields, values, strict=True):
        setattr(message, field, float(value))


def _colour(rgba: tuple[float, float, float, float]) -> Color:
    return Color(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3])


def _time(unix_ns: int) -> Timestamp:
    return Timestamp(seconds=unix_ns // NANOSECONDS, nanos=unix_ns % NANOSECONDS)
