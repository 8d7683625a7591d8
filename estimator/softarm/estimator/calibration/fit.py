"""Robust Gauss-Newton over the unknowns of a calibration, with their prior among the data.

It minimises sum_i w_i rho(r_i / s_c(i)) / tau + sum (mean - value)^2 / spread^2, with rho the Huber loss,
w_i the nodes' weights, s_c the scatter of the residuals of a kind of sensor (estimated along the way: a model
is never exact, so the sensors' own noise would make it overconfident), mean and spread those of the prior,
and tau the number of nodes that count as one, from the residuals' correlation in time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import Forward, NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.sensing import Bend, MarkerPosition, MeasuredPose, Measurement, Orientation
from softarm.estimator.sensing.model_error import vented
from softarm.estimator.statistics import (
    MAD_TO_STD,
    correlation_length,
    huber_loss,
    huber_weight,
    weighted_median,
)

PULLED = ", pulled"
"""Runs with known forces have a scatter of their own: the arm hangs near rest, where a model is truer."""
PRESSURISED_PULL = ", held"
"""Under pressure and drawn by a gauge at once."""
PRESSURISED_PULL_WEIGHT = 9.0
"""Weight of a known force under pressure: an inexact model shall err elsewhere, not in the forces."""
PULL_SCATTER_FACTOR = 1.0 / 3.0
"""A known force determines the stiffness itself, pressures only by gravity and the area that they push on.

An inexact model shall err in the pressures, whose gains can make up for it.
"""
LEAST_GAIN = 0.1
"""Decrease of twice the log likelihood in one step at which a fit ends.

A step of a third of a deviation gains as much. Along directions that the data hardly determine, Gauss-Newton
continues for long with steps that gain less, each of which costs a solve of every node.
"""
SETTLING = 4  # evaluations after which scatter and correlation stay, so that one function is minimised
# Shares of the curvature's diagonal (Marquardt 1963): the first one, and that at which no step gains any
# more.
FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e6


@dataclass(frozen=True)
class ResidualRows:
    """All residuals of all runs, one per row.

    Args:
        innovation: Measured minus predicted, shape (rows,).
        jacobian: Derivative of the prediction by the unknowns, shape (rows, unknowns).
        rigid: Derivative by a rigid motion of the arm, for sensors in the laboratory frame, shape (rows, 6).
        run: Number of its run, shape (rows,).
        kind: What each row shares its scatter with: rows of one kind of sensor and unit.
        unit: Unit of each row.
        weight: Weight of its node, shape (rows,).
        noise: Standard deviation of its sensor's own noise, shape (rows,).
        block: Number of its block, over all runs, shape (rows,).
    """

    innovation: Floats
    jacobian: Floats
    rigid: Floats
    run: NDArray[np.int64]
    kind: NDArray[np.str_]
    unit: NDArray[np.str_]
    weight: Floats
    noise: Floats
    block: NDArray[np.int64]


@dataclass(frozen=True)
class Scatter:
    """How far residuals scatter, and how many of them count as one.

    Args:
        sizes: Scatter of each kind of row, or of each unit.
        correlated: Number of nodes that count as one.
    """

    sizes: Mapping[str, float]
    correlated: float = 1.0

    @classmethod
    def of(
        cls, rows: "ResidualRows", evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]
    ) -> "Scatter":
        """Estimate both from residuals."""
        return cls(_scatter(rows), mean_correlation_length(evaluations, nodes))

    def along(self, rows: "ResidualRows") -> Floats:
        """Return the scatter of each row, shape (rows,)."""
        keys = rows.kind if set(rows.kind.tolist()) <= set(self.sizes) else rows.unit
        return np.array([self.sizes[str(key)] for key in keys])


@dataclass(frozen=True)
class CalibrationFit:
    """Where a fit ended.

    Args:
        values: Values of the unknowns, shape (unknowns,).
        covariance: Their covariance: the larger of that of the curvature and that of the blocks'
            disagreement, shape (unknowns, unknowns).
        evaluations: The model there, per run.
        scatter: Scatter of the residuals.
        status: ``converged`` or ``iterations_exhausted``.
        iterations: Number of evaluations of the model at all nodes.
        remaining_steps: Step that is left of each unknown, over its standard deviation, shape (unknowns,).
    """

    values: Floats
    covariance: Floats
    evaluations: tuple[NodePredictions, ...]
    scatter: Scatter
    status: str
    iterations: int
    remaining_steps: Floats


def fit(
    forward: Forward,
    start: Floats,
    *,
    iterations: int = 15,
    tolerance: float = 0.05,
    evaluations: Sequence[NodePredictions] | None = None,
    scatter: Scatter | None = None,
) -> CalibrationFit:
    """Fit the unknowns to the nodes.

    Args:
        forward: Model, unknowns and nodes.
        start: Values to begin with, shape (unknowns,).
        iterations: Largest number of evaluations.
        tolerance: A step shorter than this share of every standard deviation ends the search.
        evaluations: An earlier evaluation for a warm start of the model.
        scatter: Scatter of the residuals; estimated along the way where it is left out.
    """
    values, damping, count, estimated = start, FIRST_DAMPING, 1, scatter is None
    gain = np.inf
    current = forward.evaluate(values, evaluations)
    while True:
        rows = collect(current, forward.nodes)
        if scatter is None or (estimated and count <= SETTLING):
            scatter = Scatter.of(rows, current, forward.nodes)
        normal, gradient, cost = _normal_equations(forward, rows, values, scatter)
        step, remaining_steps = _step(normal, gradient, damping)
        settled = bool(remaining_steps.max(initial=0.0) < tolerance) or gain < LEAST_GAIN
        if settled or count >= iterations:
            break
        candidate = forward.evaluate(values + step, current)
        count += 1
        new_rows = collect(candidate, forward.nodes)
        _, _, new_cost = _normal_equations(forward, new_rows, values + step, scatter)
        # Only a step that nothing held back, on the same rows and scatter, shows by its gain that the end is
        # near.
        free = (
            damping <= FIRST_DAMPING and count > SETTLING and len(new_rows.innovation) == len(rows.innovation)
        )
        gain = abs(cost - new_cost) if free else np.inf
        # A cost that falls because equilibria are lost is no improvement.
        if len(new_rows.innovation) >= 0.9 * len(rows.innovation) and new_cost <= cost * (1 + 1e-9):
            values, current, damping = values + step, candidate, max(damping * 0.2, 1e-9)
        elif damping < LARGEST_DAMPING:
            damping = max(damping * 10.0, 1e-2)
        else:
            break
    covariance = _covariance(forward, rows, scatter, normal)
    covariance += _registration_covariance(forward, rows, scatter, normal)
    status = "converged" if settled else "iterations_exhausted"
    return CalibrationFit(values, covariance, current, scatter, status, count, remaining_steps)


def left_out(forward: Forward, solution: CalibrationFit) -> tuple[NodePredictions, ...]:
    """Return the predictions of each block by the fit to all others, per run.

    To first order about the fit to all: without the normal equations N_b and the gradient g_b of a block, the
    fit moves by (N - N_b)^-1 (g - g_b).
    """
    rows = collect(solution.evaluations, forward.nodes)
    normal, gradient, _ = _normal_equations(forward, rows, solution.values, solution.scatter)
    scale, whitened, weight = _whitened(rows, solution.scatter)
    innovation = rows.innovation.copy()
    for block in np.unique(rows.block):
        in_block = rows.block == block
        jacobian = rows.jacobian[in_block] / scale[in_block, None]
        weighted = jacobian.T * weight[in_block]
        step = np.linalg.solve(normal - weighted @ jacobian, gradient - weighted @ whitened[in_block])
        innovation[in_block] -= rows.jacobian[in_block] @ step
    predictions, first = [], 0
    for evaluation in solution.evaluations:
        observed = np.isfinite(evaluation.innovation)
        unseen = evaluation.innovation.copy()
        unseen[observed] = innovation[first : first + int(observed.sum())]
        first += int(observed.sum())
        predictions.append(replace(evaluation, innovation=unseen))
    return tuple(predictions)


def robust_cost(
    forward: Forward, evaluations: Sequence[NodePredictions], values: Floats, scatter: Scatter
) -> float:
    """Compute what a fit minimises, at values that were evaluated."""
    return _normal_equations(forward, collect(evaluations, forward.nodes), values, scatter)[2]


def collect(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> ResidualRows:
    """Stack the residuals that are present."""
    parts = []
    first_block = 0
    for number, (evaluation, run_nodes) in enumerate(zip(evaluations, nodes, strict=True)):
        suite = run_nodes.run.suite
        kind = np.empty(suite.size, dtype="U64")
        held = run_nodes.run.pulled & ~vented(run_nodes.pressures)
        registered = np.zeros(suite.size)
        for measurement in suite.measurements:
            rows = suite.slices[measurement.name]
            kind[rows] = _kinds(measurement)
            registered[rows] = measurement.registration is not None
        observed = np.isfinite(evaluation.innovation)
        shape = evaluation.innovation.shape
        suffix = np.where(held, PRESSURISED_PULL, PULLED if run_nodes.run.pulled else "")
        parts.append(
            ResidualRows(
                evaluation.innovation[observed],
                evaluation.jacobian[observed],
                (evaluation.rigid * registered[:, None])[observed],
                np.broadcast_to(number, shape)[observed],
                np.char.add(kind[None, :], suffix[:, None])[observed],
                np.broadcast_to(np.array(suite.units), shape)[observed],
                np.broadcast_to(run_nodes.weights[:, None], shape)[observed],
                np.broadcast_to(suite.noise, shape)[observed],
                np.broadcast_to(run_nodes.blocks[:, None] + first_block, shape)[observed],
            )
        )
        first_block += int(run_nodes.blocks.max(initial=-1)) + 1
    return ResidualRows(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("innovation", "jacobian", "rigid", "run", "kind", "unit", "weight", "noise", "block")
        )
    )


def mean_correlation_length(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> float:
    """Compute the number of consecutive nodes that count as one, averaged over the sensors' rows."""
    lengths: list[float] = []
    for evaluation, run_nodes in zip(evaluations, nodes, strict=True):
        root = np.sqrt(run_nodes.weights)[:, None] * np.nan_to_num(evaluation.innovation)
        lengths.extend(map(correlation_length, root.T))
    return float(np.mean(lengths)) if lengths else 1.0


def _kinds(measurement: Measurement) -> list[str]:
    """Name what each row of a sensor shares its scatter with: all rows of one kind of sensor and unit."""
    if isinstance(measurement, MeasuredPose):
        return ["pose position"] * 3 + ["pose rotation"] * 3
    kinds = {Bend: "bend", MarkerPosition: "marker", Orientation: "orientation"}
    return [kinds[type(measurement)]] * measurement.size


def _scatter(rows: ResidualRows) -> dict[str, float]:
    """Estimate each kind's scatter by the weighted median of its residuals; not below the sensors' noise."""
    scatter = {}
    for name in np.unique(rows.kind):
        of_kind = rows.kind == name
        sizes, weights = np.abs(rows.innovation[of_kind]), rows.weight[of_kind]
        median = weighted_median(sizes, weights)
        trusted = PULL_SCATTER_FACTOR if str(name).endswith(PULLED) else 1.0
        scatter[str(name)] = max(trusted * MAD_TO_STD * median, float(rows.noise[of_kind].max()))
    return scatter


def _whitened(rows: ResidualRows, scatter: Scatter) -> tuple[Floats, Floats, Floats]:
    """Return the scatter, residuals over it, and the weights of nodes and loss, each of shape (rows,)."""
    scale = scatter.along(rows)
    whitened = rows.innovation / scale
    return scale, whitened, _node_weight(rows) * huber_weight(whitened) / scatter.correlated


def _node_weight(rows: ResidualRows) -> Floats:
    return rows.weight * np.where(np.char.endswith(rows.kind, PRESSURISED_PULL), PRESSURISED_PULL_WEIGHT, 1.0)


def _normal_equations(
    forward: Forward, rows: ResidualRows, values: Floats, scatter: Scatter
) -> tuple[Floats, Floats, float]:
    scale, whitened, weight = _whitened(rows, scatter)
    jacobian = rows.jacobian / scale[:, None]
    prior, prior_rows = forward.layout.prior_rows(values)
    weighted = jacobian.T * weight
    normal = weighted @ jacobian + prior_rows.T @ prior_rows
    gradient = weighted @ whitened + prior_rows.T @ prior
    cost = float((_node_weight(rows) * huber_loss(whitened)).sum()) / scatter.correlated
    return normal, gradient, cost + float(prior @ prior)


def _step(normal: Floats, gradient: Floats, damping: float) -> tuple[Floats, Floats]:
    """Return the damped step, and the share of its deviation that each unknown would move undamped."""
    damped = normal + damping * np.diag(np.diag(normal))
    step: Floats = np.linalg.solve(damped, gradient).astype(np.float64)
    deviations = np.sqrt(np.diag(np.linalg.inv(normal)))
    shares: Floats = np.abs(np.linalg.solve(normal, gradient)) / deviations
    return step, shares


def _covariance(forward: Forward, rows: ResidualRows, scatter: Scatter, normal: Floats) -> Floats:
    """Return the covariance: that of the curvature, widened by the disagreement of blocks of ten seconds.

    The second is the cluster-robust estimate H^-1 (sum_b g_b g_b^T) H^-1 with g_b a block's gradient
    (Liang and Zeger 1986); the curvature's correlations are kept and each deviation is the larger of the two.
    """
    curvature: Floats = np.linalg.inv(normal).astype(np.float64)
    blocks = np.unique(rows.block)
    # Two blocks do not show how much blocks differ.
    if len(blocks) < 3:
        return curvature
    scale, whitened, weight = _whitened(rows, scatter)
    scores = rows.jacobian * (weight * whitened / scale)[:, None]
    gradients = np.array([scores[rows.block == block].sum(axis=0) for block in blocks])
    # The last factor corrects for the small number of blocks.
    spread = curvature @ (gradients.T @ gradients) @ curvature * len(blocks) / (len(blocks) - 1)
    prior = np.diag(forward.layout.prior_covariance())
    # No wider than the prior: data cannot make an unknown less certain.
    widest = np.minimum(
        np.maximum(np.diag(spread), np.diag(curvature)), np.maximum(prior, np.diag(curvature))
    )
    ratio = np.sqrt(widest / np.diag(curvature))
    covariance: Floats = curvature * np.outer(ratio, ratio)
    return covariance


def _registration_covariance(
    forward: Forward, rows: ResidualRows, scatter: Scatter, normal: Floats
) -> Floats:
    """Return what the errors of the laboratory's registrations add: they move all readings of a run together.

    An error e of covariance C moves the fit by H^-1 J^T W R e, with R the derivative by a rigid motion.
    """
    scale, _, weight = _whitened(rows, scatter)
    total = np.zeros_like(normal)
    for number, run_nodes in enumerate(forward.nodes):
        covariances = [m.registration.covariance for m in run_nodes.run.suite.measurements if m.registration]
        part = rows.run == number
        if not covariances or not part.any():
            continue
        weighted = rows.jacobian[part].T * (weight[part] / scale[part] ** 2)
        gain = np.linalg.solve(normal, weighted @ rows.rigid[part])
        total += gain @ covariances[0] @ gain.T
    return total
