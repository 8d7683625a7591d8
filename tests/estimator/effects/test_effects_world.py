from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.rotations import exp
from tests.estimator.simulation.straight_arm import HEIGHTS, world


def test_a_segment_of_even_cross_section_that_bends_to_an_arc_has_its_centroid_inside():
    """A clamped arc of radius R and angle a about y has the centroid R (1 - sin a / a), R (1 - cos a) / a."""
    mass, angle = 0.16, 0.8
    radius = HEIGHTS[0] / angle
    weighed = replace(world(), masses=np.zeros(2), segment_masses=np.array([mass, 0.0]))
    end = radius * np.array([1.0 - np.cos(angle), 0.0, np.sin(angle)])
    positions, rotations = np.tile(end, (1, 2, 1)), np.tile(exp(np.array([0.0, angle, 0.0])), (1, 2, 1, 1))
    centroid = radius * np.array([1.0 - np.sin(angle) / angle, 0.0, (1.0 - np.cos(angle)) / angle])
    assert weighed.first_moment(positions, rotations)[0] / mass == pytest.approx(centroid, abs=2e-4)


def test_a_segment_that_narrows_has_its_centroid_closer_to_its_wider_end():
    """A truncated cone whose radius halves: 11/28 of its length from the wider end, by integration."""
    arm = world()
    radii = np.append(np.tile(1.0 - 0.5 * (np.arange(4) + 0.5) / 4, 2), 0.5)
    narrowing = replace(arm, surface=replace(arm.surface, radii=radii))
    weighed = replace(narrowing, masses=np.zeros(2), segment_masses=np.array([1.0, 0.0]))
    straight = np.zeros((1, 2, 3))
    straight[0, :, 2] = HEIGHTS
    moment = weighed.first_moment(straight, np.tile(np.eye(3), (1, 2, 1, 1)))
    assert moment[0, 2] == pytest.approx(11.0 / 28.0 * HEIGHTS[0], rel=0.02)


def test_sections_weigh_at_their_origins():
    weighed = replace(world(), masses=np.array([0.02, 0.03]), segment_masses=np.zeros(2))
    positions = np.array([[[0.01, 0.0, 0.1], [0.0, 0.02, 0.2]]])
    moment = weighed.first_moment(positions, np.tile(np.eye(3), (1, 2, 1, 1)))
    assert moment[0] == pytest.approx([2e-4, 6e-4, 8e-3])
