"""What the arm remembers of a pull once it is over, expressed as a force.

Rubber that was strained and let go does not return at once, nor the whole way. With r the readings measured
minus predicted at the first node after a pull at which the cord is slack, r_0 at the last one before it, the
estimate there explains r - r_0 by a force e. The remembered share is the part of e along the largest force F
of the pull, over F.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.force_accuracy import LATERAL, PULLED
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.load_equations import load_equations, load_readings
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.significance import student_factor
from softarm.estimator.sensing.model_error import ModelError, vented
from softarm.estimator.specimen import Value


def force_memory_shares(
    setting: Setting,
    evaluations: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    scatter: Mapping[str, float],
) -> dict[str, Value]:
    """Compute which share of a force on the vented arm is remembered, by section that was pulled.

    It is the mean over the pulls. Within two of its standard deviations lie 95 % of the shares of further
    pulls, by Student's t; that of a single pull is as uncertain as it is large.

    Args:
        setting: The calibration.
        evaluations: What it predicts, per run; of every node by the same values, since changes count.
        nodes: The nodes that it predicts; each pull is a block, from slack to slack.
        scatter: About its predictions, by sensor, quantity and condition [m or rad].
    """
    shares: dict[str, list[float]] = {}
    model_scatter = ModelError.of(scatter).vented.scatter
    for at, run_nodes in zip(evaluations, nodes, strict=True):
        if not run_nodes.run.pulled:
            continue
        slack = (np.abs(run_nodes.loads) <= LEAST_PULL).all(axis=1)
        usable = vented(run_nodes.pressures) & at.converged
        for block in np.unique(run_nodes.blocks)[1:]:
            inside = usable & (run_nodes.blocks == block)
            before = np.flatnonzero(usable & slack & (run_nodes.blocks == block - 1))
            taut, after = np.flatnonzero(inside & ~slack), np.flatnonzero(inside & slack)
            if not (len(before) and len(taut) and len(after)):
                continue
            strongest = taut[np.argmax(np.linalg.norm(run_nodes.loads[taut], axis=1))]
            pull = setting.pulls(run_nodes.loads[[strongest]])[0]
            first = int(np.argmax(np.abs(pull))) // PULLED * PULLED
            lateral = pull[first : first + LATERAL]
            change = at.innovation[[after[0]]] - at.innovation[[before[-1]]]
            node = np.arange(len(run_nodes.time)) == after[0]
            to_loads, noise = load_readings(setting, at.keep(node), run_nodes.keep(node), model_scatter)
            there = to_loads[:, :, first : first + LATERAL]
            (information,), (right,) = load_equations(there, noise, change)
            if np.linalg.matrix_rank(information) == LATERAL and np.linalg.norm(lateral) > LEAST_PULL:
                wrong = np.linalg.solve(information, right)
                section = run_nodes.run.load_names[first].rpartition("_")[0]
                share = float(wrong @ lateral / (lateral @ lateral))
                shares.setdefault(section, []).append(share)
    return {section: _of_further_pulls(np.array(values)) for section, values in shares.items()}


def _of_further_pulls(shares: Floats) -> Value:
    """Return the mean share and the standard deviation of that of a further pull."""
    count, mean = len(shares), float(shares.mean())
    if count == 1:
        return Value(value=mean, std=abs(mean))
    spread = float(shares.std(ddof=1) * np.sqrt(1.0 + 1.0 / count)) * student_factor(count - 1)
    return Value(value=mean, std=spread)
