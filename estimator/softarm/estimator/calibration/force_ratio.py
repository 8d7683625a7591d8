"""Error over standard deviation of the forces that are estimated at the nodes of known pulls.

A pull f on a section and the pressures p move the readings by J_f f + J_p p. About the prediction under the
known pull, what is measured minus predicted, r, is taken for a force: the error of the estimate is e = A^-1 b
with b = J_f' C^-1 r, A = J_f' C^-1 J_f and C the noise of the sensors with the model's scatter and, through
J_p, of the pressures. A^-1 is its covariance, so that e' A e = b' A^-1 b is 1 a component on
average where r is as C says.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.sensing.model_error import (
    ON,
    PRESSURISED_PULLS,
    VENTED_PULLS,
    ModelError,
    vented,
    widened,
)

LATERAL = 2  # components of a pull that are estimated, along x and y


def force_ratios(
    setting: Setting,
    evaluations: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    scatter: Mapping[str, float],
) -> dict[str, float]:
    """Return the root mean square of error over deviation of the lateral force at known pulls.

    The result has one entry per condition and pulled section, such as ``vented pulls on tip``.

    Nodes count by their weight: a cord that moves does not pull as in an equilibrium.

    Args:
        setting: The calibration.
        evaluations: What it predicts, per run.
        nodes: The nodes that it predicts, best such as it has not seen.
        scatter: About its predictions, by sensor, quantity and condition [m or rad].
    """
    error = ModelError.of(scatter)
    squares: dict[str, list[tuple[float, float]]] = {}
    for at, run_nodes in zip(evaluations, nodes, strict=True):
        pulled = (np.abs(run_nodes.loads) > LEAST_PULL).any(axis=1) & at.converged
        for name, condition in ((VENTED_PULLS, error.vented), (PRESSURISED_PULLS, error.pressurised)):
            flags = pulled & (vented(run_nodes.pressures) == (name == VENTED_PULLS))
            if flags.any():
                suite = widened(setting.aligned(run_nodes.run.suite), condition.scatter)
                for section, square, weight in _squares(
                    setting, suite, at.keep(flags), run_nodes.keep(flags)
                ):
                    squares.setdefault(f"{name}{ON}{section}", []).append((square, weight))
    return {name: _root_mean(np.array(values)) for name, values in squares.items() if values}


def _root_mean(squares: Floats) -> float:
    return float(np.sqrt(np.average(squares[:, 0], weights=squares[:, 1])))


def _squares(
    setting: Setting, suite: SensorSuite, at: NodePredictions, run_nodes: Nodes
) -> list[tuple[str, float, float]]:
    """Return the pulled section, the mean square of error over deviation and the weight of each node.

    The estimate knows no axial pull.
    """
    twists = np.nan_to_num(suite.sensitivity(at.frames, run_nodes.readings).twists)
    to_pressures, to_loads = twists @ at.response.pressure_jacobian, twists @ at.response.load_jacobian
    spread = np.diag(setting.actuation.chamber_sigma**2)
    noise = suite.covariance(at.frames, run_nodes.readings, twists)
    noise = noise + to_pressures @ spread @ np.swapaxes(to_pressures, 1, 2)
    squares = []
    for node, pull in enumerate(setting.pulls(run_nodes.loads)):
        # Three components a section: that of the largest is the section pulled on.
        first = int(np.argmax(np.abs(pull))) // 3 * 3
        axial = first + LATERAL
        # The estimate has no axial load: what the prediction owes to that component is missing from it.
        missed = at.innovation[node] + to_loads[node, :, axial] * pull[axial]
        observed = np.flatnonzero(np.isfinite(missed))
        rows = to_loads[node][observed, first:axial]
        weighed = np.linalg.solve(
            noise[node][np.ix_(observed, observed)], np.column_stack([rows, missed[observed]])
        )
        matched = rows.T @ weighed
        if np.linalg.matrix_rank(matched[:, :LATERAL]) == LATERAL:
            b = matched[:, LATERAL]
            square = float(b @ np.linalg.solve(matched[:, :LATERAL], b)) / LATERAL
            section = run_nodes.run.load_names[first].rpartition("_")[0]
            squares.append((section, square, float(run_nodes.weights[node])))
    return squares
