"""Check a calibration for drift: do new recordings scatter more about its predictions than it states?"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.calibration.arrange import CalibrationRun
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import build_layout
from softarm.estimator.calibration.nodes import NEVER_SIMULTANEOUS, RECORD_SIMULTANEOUSLY, Nodes, choose_nodes
from softarm.estimator.calibration.outcome import by_quantity
from softarm.estimator.calibration.regression import estimate_lag
from softarm.estimator.calibration.scatter import rms
from softarm.estimator.calibration.significance import NODES_PER_FREEDOM, scatter_limit
from softarm.estimator.errors import InputError
from softarm.estimator.response import BatchArmModel
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.specimen import Specimen

CALIBRATION_FREEDOM = 10.0
"""Independent samples that a calibration's scatter counts as."""


@dataclass(frozen=True)
class Drift:
    """How one quantity of one sensor scatters now.

    Args:
        quantity: Such as ``frame_tip rotation``.
        scatter: Root mean square of measured minus predicted now [m or rad].
        calibrated: That on held-out blocks of the calibration.
        stale: Whether it has grown significantly, and by more than ``LEAST_RATIO``.
    """

    quantity: str
    scatter: float
    calibrated: float
    stale: bool

    @property
    def ratio(self) -> float:
        """Scatter now over that of the calibration."""
        return self.scatter / self.calibrated


def check_drift(
    model: BatchArmModel, specimen: Specimen, runs: Sequence[CalibrationRun], nodes: int = 60
) -> tuple[Drift, ...]:
    """Compare recordings with what the specimen's calibration predicts for them.

    Args:
        model: Model with the calibration of the specimen.
        specimen: The arm.
        runs: Recordings, each as of ``arrange``.
        nodes: Largest number of samples over all runs.

    Raises:
        InputError: The specimen does not state how its calibration scattered, or no sensor is shared.
    """
    expected = specimen.calibration.scatter
    if not expected:
        raise InputError(
            f"specimen {specimen.name}", "was never calibrated", "run softarm calibrate on it first"
        )
    chosen = _nodes(runs, nodes)
    evaluations = _forward(model, specimen, chosen).evaluate(np.zeros(0))
    scatter = by_quantity(rms(evaluations, chosen))
    shared = [name for name in scatter if name in expected]
    if not shared:
        raise InputError(
            ", ".join(run.name for run in runs),
            "has no sensor that the calibration used",
            f"record one of {', '.join(expected)}",
        )
    count = sum(len(run_nodes.time) for run_nodes in chosen)
    limit = scatter_limit(count / NODES_PER_FREEDOM, CALIBRATION_FREEDOM)
    return tuple(
        Drift(name, scatter[name], expected[name], scatter[name] > limit * expected[name]) for name in shared
    )


def _nodes(runs: Sequence[CalibrationRun], count: int) -> tuple[Nodes, ...]:
    aligned = [run.delayed(lag) if (lag := estimate_lag(run)) else run for run in runs]
    chosen = tuple(choose_nodes(run, max(8, count // len(runs))) for run in aligned)
    if not sum(len(run_nodes.time) for run_nodes in chosen):
        raise InputError(", ".join(run.name for run in runs), NEVER_SIMULTANEOUS, RECORD_SIMULTANEOUSLY)
    return tuple(run_nodes for run_nodes in chosen if len(run_nodes.time))


def _forward(model: BatchArmModel, specimen: Specimen, nodes: tuple[Nodes, ...]) -> Forward:
    """Settle every unknown at its calibrated value."""
    measurements = {m.name: m for run_nodes in nodes for m in run_nodes.run.suite.measurements}
    suite = SensorSuite(tuple(measurements.values()))
    layout = build_layout(
        specimen, suite, nodes[0].run.pressure_source, (), model.regions, sections=model.sections
    )
    settled = layout.without(layout.names)
    return Forward(model, settled, nodes)
