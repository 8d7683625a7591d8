"""The loads by which an estimate explains the residuals at the nodes of a run.

With r the residual, J its derivative by the loads and C the noise of the sensors with the model's scatter
and, through the derivative by them, of the pressures, an estimate explains r by the loads (J' C^-1 J)^-1 J'
C^-1 r.
"""

from collections.abc import Mapping

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.sensing.model_error import widened


def load_readings(
    setting: Setting, at: NodePredictions, run_nodes: Nodes, scatter: Mapping[str, float]
) -> tuple[Floats, Floats]:
    """Return the derivative of the readings by the known loads, and their noise.

    Args:
        setting: The calibration.
        at: What it predicts at the nodes.
        run_nodes: The nodes.
        scatter: About the predictions, by sensor and quantity [m or rad].

    Returns:
        J, shape (nodes, rows, loads), and C, shape (nodes, rows, rows).
    """
    suite = widened(setting.aligned(run_nodes.run.suite), scatter)
    twists = np.nan_to_num(suite.sensitivity(at.frames, run_nodes.readings).twists)
    to_pressures, to_loads = twists @ at.response.pressure_jacobian, twists @ at.response.load_jacobian
    noise = suite.covariance(at.frames, run_nodes.readings, twists)
    by_pressures = to_pressures @ np.diag(setting.actuation.chamber_sigma**2) @ to_pressures.swapaxes(1, 2)
    return to_loads, noise + by_pressures


def load_equations(to_loads: Floats, noise: Floats, residual: Floats) -> tuple[Floats, Floats]:
    """Compute the normal equations of the loads.

    Args:
        to_loads: J, shape (nodes, rows, loads).
        noise: C, shape (nodes, rows, rows).
        residual: r, NaN where absent, shape (nodes, rows).

    Returns:
        J' C^-1 J, shape (nodes, loads, loads), and J' C^-1 r, shape (nodes, loads).
    """
    observed = np.isfinite(residual)
    noise = np.where(observed[:, :, None] & observed[:, None, :], noise, np.eye(noise.shape[1]))
    rows = to_loads * observed[:, :, None]
    right = np.concatenate([rows, np.where(observed, residual, 0.0)[:, :, None]], axis=2)
    matched = rows.swapaxes(1, 2) @ np.linalg.solve(noise, right)
    return matched[:, :, :-1], matched[:, :, -1]
