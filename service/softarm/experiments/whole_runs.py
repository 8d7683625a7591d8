"""Samples spread over a whole run, for errors that do not need holds."""

import numpy as np

from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.nodes import choose_nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.experiments.holds import Holds


def sampled(run: CalibrationRun, count: int, *, pulled: bool = False) -> Holds:
    """Average a run over short windows, evenly spread.

    Args:
        run: What was recorded.
        count: Number of windows.
        pulled: Keep only those at which a known force acts.
    """
    nodes = choose_nodes(run, 4 * count if pulled else count)
    members = np.arange(len(nodes.time))
    if pulled:
        members = np.flatnonzero((np.abs(nodes.loads) > LEAST_PULL).any(axis=1))
    picked = members[np.unique(np.linspace(0, len(members) - 1, count).astype(int))] if len(members) else []
    chosen = nodes.keep(np.isin(np.arange(len(nodes.time)), picked))
    return Holds(run, chosen.time, chosen.pressures, chosen.readings, chosen.loads)
