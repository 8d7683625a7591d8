"""How readings scatter about a calibrated model, apart for the conditions in which it errs unlike."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.outcome import by_quantity
from softarm.estimator.sensing.model_error import PRESSURISED_PULLS, VENTED_PULLS, vented


def rms(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> dict[str, float]:
    """Return the root mean square of the innovations by component of each sensor, over all runs."""
    squares: dict[str, list[Floats]] = {}
    for evaluation, run_nodes in zip(evaluations, nodes, strict=True):
        for name, rows in run_nodes.run.suite.slices.items():
            for number, column in enumerate(evaluation.innovation[:, rows].T):
                squares.setdefault(f"{name}.{number}", []).append(column[np.isfinite(column)] ** 2)
    joined = {name: np.concatenate(parts) for name, parts in squares.items()}
    return {name: float(np.sqrt(values.mean())) for name, values in joined.items() if len(values)}


def scatter_by_condition(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> dict[str, float]:
    """Return the scatter of each sensor by quantity: without known forces, and by name while a gauge pulls.

    An arm that hangs vented, drawn by a gauge, stays near rest and scatters less than one under pressure.
    Pulls against pressures stay in the plane in which these bend the arm, and hardly twist it: under pressure
    its torsion scatters no less than without pulls.
    """
    conditions = {
        "": [np.full(len(run_nodes.time), not run_nodes.run.pulled) for run_nodes in nodes],
        f", {VENTED_PULLS}": [run_nodes.run.pulled & vented(run_nodes.pressures) for run_nodes in nodes],
        f", {PRESSURISED_PULLS}": [
            run_nodes.run.pulled & ~vented(run_nodes.pressures) for run_nodes in nodes
        ],
    }
    scatter: dict[str, float] = {}
    for suffix, flags in conditions.items():
        pairs = [
            (evaluation.keep(chosen), run_nodes.keep(chosen))
            for evaluation, run_nodes, chosen in zip(evaluations, nodes, flags, strict=True)
            if chosen.any()
        ]
        if pairs:
            parts = by_quantity(rms([pair[0] for pair in pairs], [pair[1] for pair in pairs]))
            scatter |= {f"{name}{suffix}": value for name, value in parts.items()}
        # With a gauge in every run, scatter under pulls stands in for that without.
        elif not suffix:
            scatter = by_quantity(rms(evaluations, nodes))
    for name, value in scatter.items():
        free = name.removesuffix(f", {PRESSURISED_PULLS}")
        if name != free and free.endswith(" torsion"):
            scatter[name] = max(value, scatter.get(free, 0.0))
    return scatter
