"""The body around the rod, for pictures: every point moves with the stations above and below it."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.rod.chain import Chain


def skin(points: Floats, chain: Chain, strain: Floats) -> Floats:
    """Move material points along with the rod.

    Between two stations a point is where both put it, weighted by height; beyond the last it moves with that.
    Cross-sections stay as they are: the swelling of the chambers does not show.

    Args:
        points: Points at rest [m], shape (points, 3).
        chain: The links.
        strain: Strains of the links, shape (links, 6).
    """
    frames = chain.station_frames(strain)
    link = np.clip(np.searchsorted(chain.heights, points[:, 2], side="right") - 1, 0, chain.links - 1)
    share = np.clip((points[:, 2] - chain.heights[link]) / chain.lengths[link], 0.0, 1.0)
    moved = np.zeros_like(points)
    for station, weight in ((link, 1.0 - share), (link + 1, share)):
        arm = points - np.array([0.0, 0.0, 1.0]) * chain.heights[station][:, None]
        there = frames.positions[station] + np.einsum("nij,nj->ni", frames.rotations[station], arm)
        moved += weight[:, None] * there
    return moved
