"""Leave-one-out validation, as the paper does it: each pose predicted by a fit to all the others.

The fits share one linearisation at the calibrated specimen. With J_i and r_i the whitened rows of pose i and
P the prior information, the fit without pose i moves the unknowns by
(sum_{j != i} J_j^T J_j + P)^-1 sum_{j != i} J_j^T r_j and leaves r_i - J_i times that.
"""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import build_layout
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.response import BatchArmModel
from softarm.estimator.specimen import Specimen
from softarm.experiments.validation import PoseErrors, by_section, pose_deviation


def leave_one_out_errors(
    model: BatchArmModel, specimen: Specimen, holds: CalibrationRun
) -> tuple[PoseErrors, ...]:
    """Predict each held pose from a fit to the others.

    Args:
        model: Model of the specimen with ``section_forces``.
        specimen: The calibrated robot, about which the fits are linearised.
        holds: The poses.
    """
    count = len(holds.time)
    nodes = Nodes(
        replace(holds, gravity=np.array(specimen.gravity_m_s2)),
        holds.time,
        holds.pressures,
        holds.readings,
        np.nan_to_num(holds.loads),
        np.ones(count),
        np.arange(count),
    )
    moved = [k for k in range(holds.pressures.shape[1]) if np.ptp(holds.pressures[:, k]) > 1e3]
    layout = build_layout(
        specimen, holds.suite, holds.pressure_source, moved, model.regions, sections=model.sections
    )
    forward = Forward(model, layout, (nodes,))
    (at,) = forward.evaluate(layout.means)
    deviations = pose_deviation(specimen, holds.suite)
    residual = np.where(np.isfinite(at.innovation), at.innovation, 0.0) / deviations
    jacobian = np.where(np.isfinite(at.innovation)[..., None], at.jacobian, 0.0) / deviations[:, None]
    prior = np.asarray(np.linalg.inv(layout.prior_covariance()), dtype=np.float64)
    innovation = without_each(residual, jacobian, prior) * deviations
    innovation[~np.isfinite(at.innovation)] = np.nan
    return by_section(innovation, deviations, holds.suite)


def without_each(residual: Floats, jacobian: Floats, prior: Floats) -> Floats:
    """Return the residual of each pose in a linear fit to the others, shape (poses, rows).

    Args:
        residual: Whitened, shape (poses, rows).
        jacobian: Shape (poses, rows, unknowns).
        prior: Prior information, shape (unknowns, unknowns).
    """
    normals = np.einsum("pra,prb->pab", jacobian, jacobian)
    gradients = np.einsum("pra,pr->pa", jacobian, residual)
    normal, gradient = normals.sum(axis=0) + prior, gradients.sum(axis=0)
    held_out = np.empty_like(residual)
    for index in range(len(residual)):
        step = np.linalg.solve(normal - normals[index], gradient - gradients[index])
        held_out[index] = residual[index] - jacobian[index] @ step
    return held_out
