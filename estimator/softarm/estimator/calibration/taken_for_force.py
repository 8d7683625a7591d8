"""The force that an estimate takes the errors of a model for."""

from collections.abc import Mapping

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.sensing.model_error import widened


def taken_for_force(
    setting: Setting,
    at: NodePredictions,
    run_nodes: Nodes,
    scatter: Mapping[str, float],
    loads: slice,
    innovation: Floats,
) -> tuple[Floats, Floats]:
    """Compute the loads that readings are taken for.

    With r the innovation, J_f its derivative by the loads and C the noise of the sensors, of the model and,
    through the derivative by them, of the pressures: e = A^-1 J_f' C^-1 r, A = J_f' C^-1 J_f.

    Args:
        setting: The calibration.
        at: What it predicts at the nodes.
        run_nodes: The nodes.
        scatter: About the predictions, by sensor and quantity [m or rad].
        loads: Which of the known loads are estimated.
        innovation: r, NaN where absent, shape (nodes, rows).

    Returns:
        e [N], shape (nodes, loads), and its covariance A^-1, shape (nodes, loads, loads); NaN at nodes whose
        readings do not show every load.
    """
    suite = widened(setting.aligned(run_nodes.run.suite), scatter)
    twists = np.nan_to_num(suite.sensitivity(at.frames, run_nodes.readings).twists)
    to_pressures, to_loads = twists @ at.response.pressure_jacobian, twists @ at.response.load_jacobian
    noise = suite.covariance(at.frames, run_nodes.readings, twists)
    noise = noise + to_pressures @ np.diag(setting.actuation.chamber_sigma**2) @ to_pressures.swapaxes(1, 2)
    observed = np.isfinite(innovation)
    noise = np.where(observed[:, :, None] & observed[:, None, :], noise, np.eye(noise.shape[1]))
    rows = to_loads[:, :, loads] * observed[:, :, None]
    weighed = np.linalg.solve(noise, rows).swapaxes(1, 2)
    information = weighed @ rows
    shown = np.linalg.matrix_rank(information) == rows.shape[2]
    covariance = np.full(information.shape, np.nan)
    covariance[shown] = np.linalg.inv(information[shown])
    right = weighed @ np.where(observed, innovation, 0.0)[:, :, None]
    return (covariance @ right)[:, :, 0], covariance
