"""A linear arm of two segments about its straight rest pose, known in closed form."""

import numpy as np

from softarm.estimator.effects import World
from softarm.estimator.effects.surface import Surface
from softarm.estimator.model import Frames
from softarm.estimator.response import ArmResponse
from softarm.estimator.simulation import Drive, LinearisedArm, Segments

HEIGHTS = np.array([0.13, 0.27])
STIFFNESS = np.array([[0.04, 0.04, 0.03, 60.0], [0.03, 0.03, 0.02, 50.0]])
AZIMUTHS = np.radians([0.0, 120.0, 240.0] * 2)
MASSES = np.array([0.02, 0.08])
REST = Frames(np.array([[0.0, 0.0, 0.13], [0.0, 0.0, 0.27]]), np.tile(np.eye(3), (2, 1, 1)))
SEGMENTS = Segments(("upper", "lower"), (-1, 0), (0, 1), REST)


def surface_of(segments: Segments) -> Surface:
    """A surface 15 mm from the axis, 5 mm beyond the last section."""
    end = float(segments.rest.positions[-1, 2]) + 0.005
    return Surface.of(segments, end, lambda heights: np.full(len(heights), 0.015))


def twists_by_strains() -> np.ndarray:
    """Twists of the sections per strain, shape (12, 8): a joint in the middle of each segment."""
    motion = np.zeros((2, 6, 2, 4))
    for g, joint in enumerate((0.065, 0.20)):
        for s in range(g, 2):
            lever = np.array([0.0, 0.0, HEIGHTS[s] - joint])
            motion[s, 3:, g, :3] = np.eye(3)
            motion[s, :3, g, :3] = np.column_stack([np.cross(axis, lever) for axis in np.eye(3)])
            motion[s, 2, g, 3] = 1.0
    return motion.reshape(12, 8)


def straight_arm(time: np.ndarray) -> LinearisedArm:
    by_strain = twists_by_strains()
    forces = np.zeros((8, 6))
    for k, azimuth in enumerate(AZIMUTHS):
        forces[4 * (k // 3) : 4 * (k // 3) + 2, k] = 3e-7 * np.array([-np.sin(azimuth), np.cos(azimuth)])
        forces[4 * (k // 3) + 3, k] = 2e-5
    weights = np.zeros((2, 6, 3))
    weights[:, :3] = MASSES[:, None, None] * np.eye(3)
    applied = np.concatenate([forces, by_strain.T, by_strain.T @ weights.reshape(12, 3)], axis=1)
    motion = by_strain @ (applied / STIFFNESS.reshape(8, 1))
    drive = Drive.of(time, np.zeros((len(time), 6)), np.zeros(3), 2, 2)
    frames = Frames(np.tile(REST.positions, (len(time), 1, 1)), np.tile(REST.rotations, (len(time), 1, 1, 1)))
    response = ArmResponse(
        frames,
        np.ones(len(time), dtype=bool),
        6,
        np.tile(motion, (len(time), 1, 1)),
        eigenstrain_jacobian=np.tile(by_strain, (len(time), 1, 1)),
        strains=np.zeros((len(time), 2, 4)),
    )
    return LinearisedArm(SEGMENTS, drive, response)


def world(sensors: tuple[str, ...] = ()) -> World:
    return World(
        ("upper", "lower"),
        ("intermediate", "tip"),
        sensors,
        (0, 0, 0, 1, 1, 1),
        AZIMUTHS,
        np.full(6, 65e3),
        STIFFNESS,
        MASSES,
        np.zeros(2),
        REST.positions,
        surface_of(SEGMENTS),
    )
