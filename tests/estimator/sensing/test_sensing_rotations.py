import numpy as np
import pytest

from softarm.estimator.rotations import (
    exp,
    from_quaternions,
    inverse_left_jacobian,
    left_jacobian,
    log,
    mean_rotation,
    skew,
    to_quaternions,
)
from tests.estimator.derivatives import derivative_error

RANDOM = np.random.default_rng(1)
VECTORS = RANDOM.normal(size=(200, 3))


def test_logarithm_undoes_exponential_at_every_size_of_angle() -> None:
    direction = VECTORS / np.linalg.norm(VECTORS, axis=1, keepdims=True)
    for angle in (0.0, 1e-9, 1e-5, 1e-2, 1.0, 3.0, np.pi - 1e-6):
        np.testing.assert_allclose(log(exp(angle * direction)), angle * direction, atol=1e-9)


def test_exponential_is_a_rotation_that_leaves_its_axis() -> None:
    rotations = exp(VECTORS)
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, -1, -2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose((rotations @ VECTORS[..., None])[..., 0], VECTORS, atol=1e-12)


def test_quaternions_go_both_ways_whatever_their_length_and_sign() -> None:
    rotations = exp(VECTORS * 3)
    quaternions = to_quaternions(rotations)
    np.testing.assert_allclose(from_quaternions(-2.5 * quaternions), rotations, atol=1e-14)
    assert np.isnan(from_quaternions(np.zeros(4))).all()


def test_cross_product_matrix() -> None:
    np.testing.assert_allclose(
        skew(VECTORS[:100]) @ VECTORS[100:, :, None], np.cross(VECTORS[:100], VECTORS[100:])[..., None]
    )


@pytest.mark.parametrize("size", [1e-6, 0.01, 1.0, 3.0])
def test_inverse_jacobian_is_the_derivative_of_the_logarithm(size: float) -> None:
    vector = size * VECTORS[0] / np.linalg.norm(VECTORS[0])
    error = derivative_error(
        lambda d: log(exp(d) @ exp(vector)), inverse_left_jacobian(vector), np.zeros(3), 1e-4
    )
    assert error < 1e-9
    np.testing.assert_allclose(left_jacobian(vector) @ inverse_left_jacobian(vector), np.eye(3), atol=1e-13)


def test_mean_of_scattered_rotations_is_near_their_centre() -> None:
    centre = exp(VECTORS[0])
    mean = mean_rotation(exp(0.01 * RANDOM.normal(size=(4000, 3))) @ centre)
    assert np.linalg.norm(log(mean @ centre.T)) < 0.01 * 4 / np.sqrt(4000)
