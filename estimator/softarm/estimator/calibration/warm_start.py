"""States that solves begin at, from evaluations of other nodes or of parts of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.nodes import Nodes


def nearest_states(
    solved: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    others: Sequence[NodePredictions],
    sought: Sequence[Nodes],
) -> tuple[NodePredictions, ...]:
    """Return evaluations of other nodes that begin at the states of the solved nodes of most similar inputs.

    Under moduli that a fit has changed much, a node's own earlier state is not near its equilibrium.
    """
    converged = np.concatenate([part.converged for part in solved])
    if not converged.any():
        return tuple(others)
    states = np.concatenate([part.response.states for part in solved])[converged]
    inputs = np.concatenate([_inputs(run_nodes) for run_nodes in nodes])[converged]
    scale = np.maximum(np.ptp(inputs, axis=0), 1e-9)
    tree = cKDTree(inputs / scale)
    starts = []
    for part, run_nodes in zip(others, sought, strict=True):
        near = states[tree.query(_inputs(run_nodes) / scale)[1]]
        # Called converged, since solves begin at such states only.
        response = replace(part.response, states=near, converged=np.ones(len(near), dtype=bool))
        starts.append(replace(part, response=response))
    return tuple(starts)


def _inputs(nodes: Nodes) -> Floats:
    """Return gravity, pressures and known forces, shape (nodes, 3 + chambers + loads)."""
    gravity = np.broadcast_to(nodes.run.gravity, (len(nodes.time), 3))
    return np.column_stack([gravity, nodes.pressures, nodes.loads])


def joined(
    whole: Sequence[NodePredictions],
    trained: Sequence[NodePredictions],
    held_out: Sequence[NodePredictions],
    train: Sequence[Flags],
) -> tuple[NodePredictions, ...]:
    """Return evaluations of all nodes with the model's states of the last evaluations of both parts."""
    merged = []
    for every, fitted, rest, flags in zip(whole, trained, held_out, train, strict=True):
        converged, states = every.converged.copy(), every.response.states.copy()
        for chosen, part in ((flags, fitted), (~flags, rest)):
            converged[chosen], states[chosen] = part.converged, part.response.states
        merged.append(replace(every, response=replace(every.response, states=states, converged=converged)))
    return tuple(merged)
