"""The moduli from known forces alone, before pressures are used.

A known force on the vented arm shows the stiffness itself, pressures only their effect against it. In
one fit of everything, what a model that is not exact cannot explain of the pressures would move the moduli;
so the moduli are fitted first, and held near their values while the gains are fitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.fit import CalibrationFit, fit, left_out
from softarm.estimator.calibration.force_accuracy import ForceAccuracy, force_accuracy
from softarm.estimator.calibration.forward import Forward, NodePredictions
from softarm.estimator.calibration.layout import Layout
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.unknowns import Modulus, PressureUnknown
from softarm.estimator.calibration.unpulled import unpulled_errors
from softarm.estimator.sensing.model_error import vented

FEWEST_PULLS = 5  # nodes at which a known force must act before the moduli are fitted to them
MODULUS_PRIOR_SPREAD = (
    0.002  # of a modulus' logarithm that pressures may move it from the value fitted to pulls
)
ITERATIONS = 20


@dataclass(frozen=True)
class PulledModuli:
    """Moduli that were fitted to pulls alone.

    Args:
        values: Values of all unknowns; those that pulls do not identify are as they were, shape (unknowns,).
        spreads: Standard deviation of each modulus; none where there were too few pulls.
        fitted: The pulls as they were fitted, each a block of its own, and the fit.
    """

    values: Floats
    spreads: Mapping[str, float]
    fitted: tuple[Forward, CalibrationFit] | None = None

    def near(self, layout: Layout) -> Layout:
        """Hold the moduli near to those of the pulls."""
        values = dict(zip(layout.names, self.values.tolist(), strict=True))
        return replace(
            layout,
            unknowns=tuple(
                replace(p, mean=values[p.name], spread=MODULUS_PRIOR_SPREAD) if p.name in self.spreads else p
                for p in layout.unknowns
            ),
        )

    def moved(self, layout: Layout, values: Floats) -> Floats:
        """Return values of a layout that was held near them, with these moduli, shape (unknowns,)."""
        pulled = np.array([name in self.spreads for name in layout.names])
        return np.where(pulled, layout.means, values)

    def force_accuracy(self, scatter: Mapping[str, float]) -> ForceAccuracy:
        """Judge the forces that are estimated at each pull by the fit to all others."""
        if self.fitted is None:
            return ForceAccuracy({}, {})
        forward, solution = self.fitted
        unseen = left_out(forward, solution)
        return force_accuracy(forward.layout.setting(solution.values), unseen, forward.nodes, scatter)

    def unpulled_errors(self, errors: Mapping[str, float], scatter: Mapping[str, float]) -> dict[str, float]:
        """Return the relative error of forces on sections that nobody pulled; see ``unpulled_errors``."""
        return {} if self.fitted is None else unpulled_errors(*self.fitted, errors, scatter)

    def widened(self, layout: Layout, covariance: Floats) -> Floats:
        """Return a covariance in which the moduli are no more certain than from the pulls."""
        stds = np.sqrt(np.diag(covariance))
        least = np.array([self.spreads.get(name, 0.0) for name in layout.names])
        ratio = np.maximum(stds, least) / stds
        return np.asarray(covariance * np.outer(ratio, ratio))


def moduli_from_pulls(
    forward: Forward, start: Floats, before: Sequence[NodePredictions], train: Sequence[Flags]
) -> PulledModuli:
    """Fit everything but what belongs to the pressures to the pulls on the vented arm.

    Args:
        forward: Model, unknowns and all nodes.
        start: Values to begin with, shape (unknowns,).
        before: An evaluation of all nodes, whose states the solves start from.
        train: Which nodes of each run it may see.
    """
    pulled = [flags & _vented_pulls(node_set) for node_set, flags in zip(forward.nodes, train, strict=True)]
    parts = zip(forward.nodes, pulled, strict=True)
    part = tuple(by_pull(node_set).keep(f) for node_set, f in parts if f.any())
    near = tuple(node_set.keep(f) for node_set, f in zip(before, pulled, strict=True) if f.any())
    if sum(len(nodes.time) for nodes in part) <= FEWEST_PULLS:
        return PulledModuli(start, {})
    out = {u.name for u in forward.layout.unknowns if isinstance(u, PressureUnknown)}
    layout = forward.layout.without(out)
    inside = np.array([name not in out for name in forward.layout.names])
    pulls = Forward(forward.model, layout, part)
    solution = fit(pulls, start[inside], iterations=ITERATIONS, evaluations=near)
    values = start.copy()
    values[inside] = solution.values
    deviations = np.sqrt(np.diag(solution.covariance)).tolist()
    moduli = zip(layout.unknowns, deviations, strict=True)
    spreads = {p.name: deviation for p, deviation in moduli if isinstance(p, Modulus)}
    return PulledModuli(values, spreads, (pulls, solution))


def by_pull(nodes: Nodes) -> Nodes:
    """Make one block of each pull, from slack to slack, so that it is left out as a whole.

    What the arm remembers of a pull is in all its nodes: a fit to the others would predict a node's error.
    """
    if not nodes.run.pulled:
        return nodes
    taut = np.asarray((np.abs(nodes.loads) > LEAST_PULL).any(axis=1))
    begins = np.diff(taut.astype(np.int64), prepend=0) > 0
    return replace(nodes, blocks=np.cumsum(begins.astype(np.int64)))


def _vented_pulls(nodes: Nodes) -> Flags:
    """Return at which nodes a known force acts on the vented arm, shape (nodes,)."""
    if not nodes.run.pulled:
        return np.zeros(len(nodes.time), dtype=bool)
    return np.asarray((np.abs(nodes.loads) > LEAST_PULL).any(axis=1) & vented(nodes.pressures))
