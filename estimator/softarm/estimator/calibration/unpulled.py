"""Errors that wrong moduli cause in forces on sections that no gauge pulled, beside those where one did.

A force f on such a section moves the readings by J f. Moduli that are off by d change that by D d, which an
estimate explains by the force (J' C^-1 J)^-1 J' C^-1 D d, with C the noise of the sensors and the model.

The stiffness of the sections is that of the drawing, and the moduli of the segments make up for its error at
the pulls alone: a pull on the tip bends the section between the segments, and a force on that section does
not; it bends the arm closer to its base. So the covariance is that of segments and sections together.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.fit import CalibrationFit, fit
from softarm.estimator.calibration.force_accuracy import LATERAL, PULLED
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import MODULUS_SPREAD
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.unknowns import Modulus
from softarm.estimator.sensing.model_error import ON, ModelError, widened


def unpulled_errors(
    forward: Forward, solution: CalibrationFit, errors: Mapping[str, float], scatter: Mapping[str, float]
) -> dict[str, float]:
    """Return the relative deviation of a lateral force on each section that nobody pulled, by condition.

    Args:
        forward: Model and unknowns of the fit to the pulls, and the pulls.
        solution: That fit.
        errors: Relative error of forces by condition and section that was pulled.
        scatter: About its predictions, by sensor, quantity and condition [m or rad].
    """
    sizes = np.max([np.abs(nodes.loads).max(axis=0) for nodes in forward.nodes], axis=0)
    sections = _section_moduli(forward)
    forward = replace(forward, layout=forward.layout.extended(sections))
    start = np.concatenate([solution.values, [unknown.mean for unknown in sections]])
    solution = fit(forward, start, iterations=1, evaluations=solution.evaluations, scatter=solution.scatter)
    moduli = forward.layout.of(Modulus)
    covariance = solution.covariance[np.ix_(moduli, moduli)]
    unpulled: dict[str, float] = {}
    for first in range(0, len(sizes), PULLED):
        if sizes[first : first + PULLED].max() > LEAST_PULL:
            continue
        pulls = np.zeros((1 + LATERAL, len(sizes)))
        pulls[1:, first : first + LATERAL] = sizes.max() * np.eye(LATERAL)
        moved = _taken_for_forces(forward, solution.values, pulls, first, scatter)[..., moduli]
        if np.isfinite(moved).all():
            variance = np.einsum("ka,ab,kb->k", moved, covariance, moved).mean()
            section = forward.nodes[0].run.load_names[first].rpartition("_")[0]
            for name, error in errors.items():
                where = f"{name.partition(ON)[0]}{ON}{section}"
                here = float(np.hypot(np.sqrt(variance) / sizes.max(), error))
                unpulled[where] = max(here, unpulled.get(where, 0.0))
    return unpulled


def _section_moduli(forward: Forward) -> tuple[Modulus, ...]:
    """Return the stiffness of every section of which the model has one, as uncertain as a segment's."""
    regions, scales = forward.model.regions, forward.layout.settled.scales
    return tuple(
        Modulus(
            f"modulus.{name}",
            "log factor",
            float(np.log(scales.get(name, 1.0))),
            float(MODULUS_SPREAD),
            name,
            regions.index(name),
        )
        for name in forward.model.sections
        if name in regions
    )


def _taken_for_forces(
    forward: Forward, values: Floats, pulls: Floats, first: int, scatter: Mapping[str, float]
) -> Floats:
    """Return the force along each pull for which a change of the unknowns is taken, less that at rest.

    The result is not finite where the model has no equilibrium or the section does not move; shape
    (lateral pulls, unknowns).
    """
    nodes = _repeated(forward.nodes[0], pulls)
    (at,) = replace(forward, nodes=(nodes,)).evaluate(values)
    suite = widened(
        forward.layout.setting(values).aligned(nodes.run.suite), ModelError.of(scatter).vented.scatter
    )
    twists = np.nan_to_num(suite.sensitivity(at.frames, nodes.readings).twists)
    noise = suite.covariance(at.frames, nodes.readings, twists)
    moved = np.full((LATERAL, at.jacobian.shape[-1]), np.nan)
    for axis in range(LATERAL if at.converged.all() else 0):
        rows = (twists[1 + axis] @ at.response.load_jacobian[1 + axis])[:, first : first + LATERAL]
        weighed = np.linalg.solve(noise[1 + axis], rows)
        matched = rows.T @ weighed
        if np.linalg.matrix_rank(matched) == LATERAL:
            change = at.jacobian[1 + axis] - at.jacobian[0]
            moved[axis] = np.linalg.solve(matched, weighed.T @ change)[axis]
    return moved


def _repeated(nodes: Nodes, pulls: Floats) -> Nodes:
    """Return one node of the vented arm under each of some pulls."""
    same = np.full(len(pulls), np.argmin(np.abs(nodes.loads).max(axis=1)))
    return replace(
        nodes,
        time=nodes.time[same],
        pressures=np.zeros((len(pulls), nodes.pressures.shape[1])),
        readings=nodes.readings[same],
        loads=pulls,
        weights=nodes.weights[same],
        blocks=np.zeros(len(pulls), dtype=np.int64),
    )
