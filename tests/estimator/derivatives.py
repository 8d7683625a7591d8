"""The one checker of derivatives: every Jacobian of the project is compared with central differences."""

from collections.abc import Callable

import numpy as np

from softarm.estimator.arrays import Floats


def central_difference(function: Callable[[Floats], Floats], point: Floats, steps: Floats | float) -> Floats:
    """Differentiate by fourth-order central differences.

    Args:
        function: Vector function of a vector; its value has shape (rows,).
        point: Where to differentiate, shape (columns,).
        steps: Step along each coordinate, a number or shape (columns,).

    Returns:
        Jacobian, shape (rows, columns).
    """
    columns = []
    for k, step in enumerate(np.broadcast_to(steps, point.shape)):
        shift = np.zeros_like(point)
        shift[k] = step
        near = function(point + shift) - function(point - shift)
        far = function(point + 2 * shift) - function(point - 2 * shift)
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=-1)


def derivative_error(
    function: Callable[[Floats], Floats], jacobian: Floats, point: Floats, steps: Floats | float = 1e-4
) -> float:
    """Compare a Jacobian with central differences.

    Args:
        function: Vector function of a vector; its value has shape (rows,).
        jacobian: Claimed Jacobian at the point, shape (rows, columns).
        point: Where to compare, shape (columns,).
        steps: Step along each coordinate, a number or shape (columns,).

    Returns:
        Largest difference over the columns, each relative to the largest entry of its column of the
        Jacobian, or to the largest entry of all where that column vanishes.
    """
    numeric = central_difference(function, point, steps)
    scaled = np.broadcast_to(steps, point.shape)
    size = np.abs(jacobian * scaled).max()
    columns = np.abs(numeric * scaled).max(axis=0)
    scale = np.where(columns > 1e-6 * size, columns, max(size, np.finfo(float).tiny))
    return float((np.abs(jacobian - numeric) * scaled / scale).max())
