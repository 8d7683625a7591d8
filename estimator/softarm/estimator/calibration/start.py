"""Where a fit begins: moduli at which the model has an equilibrium, and bends of their recorded size."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.fit import Scatter, robust_cost
from softarm.estimator.calibration.forward import Forward
from softarm.estimator.calibration.layout import Layout
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.search import AxesFit
from softarm.estimator.calibration.unknowns import Area, Modulus
from softarm.estimator.specimen import Specimen

# Common factors on the moduli, tried in turn.
STIFFER = (1.0, 1.4, 2.0, 2.8)
# Nodes of the highest pressures, at which an equilibrium must exist.
PROBES = 6


def solvable(forward: Forward, first: Floats, factors: Sequence[float] = STIFFER) -> Floats:
    """Stiffen the segments until the model has an equilibrium at the highest pressures.

    A model that is too soft has none: its chambers would have grown without bound at pressures that the arm
    bore.
    """
    probes = tuple(
        node_set.keep(flags) for node_set, flags in zip(forward.nodes, _highest(forward.nodes), strict=True)
    )
    probes = tuple(node_set for node_set in probes if len(node_set.time))
    modulus = forward.layout.of(Modulus)
    values = first
    for factor in factors:
        values = first + np.log(factor) * modulus
        predictions = replace(forward, nodes=probes).evaluate(values)
        if all(evaluation.converged.all() for evaluation in predictions):
            break
    return values


def best_scaled(forward: Forward, factors: Sequence[float], scatter: Scatter) -> Floats:
    """Begin with that common factor of all moduli which loses the fewest equilibria, then fits best.

    Where the areas that the pressures push on are open they have the same factor, so that bends keep their
    size.
    """
    modulus = forward.layout.of(Modulus) | forward.layout.of(Area)
    tried = []
    for number, factor in enumerate(factors):
        values = forward.layout.means + np.log(factor) * modulus
        evaluations = forward.evaluate(values)
        lost = sum(int((~evaluation.converged).sum()) for evaluation in evaluations)
        tried.append((lost, robust_cost(forward, evaluations, values, scatter), number, values))
    best: Floats = min(tried, key=lambda one: one[:3])[3]
    return best


def _highest(nodes: Sequence[Nodes]) -> tuple[Flags, ...]:
    """Return which nodes have the highest sums of pressures over all runs."""
    sums = [node_set.pressures.sum(axis=1) for node_set in nodes]
    every = np.concatenate(sums)
    chosen = np.zeros(len(every), dtype=bool)
    chosen[np.argsort(-every, kind="stable")[:PROBES]] = True
    return tuple(np.split(chosen, np.cumsum([len(node_set) for node_set in sums])[:-1]))


def sized_by_bends(specimen: Specimen, layout: Layout, first: Floats, axes: Mapping[str, AxesFit]) -> Floats:
    """Begin with moduli that give the bends their recorded size, and with the biases that remain."""
    values = np.where(layout.of(Modulus), first, layout.means)
    for index, unknown in enumerate(layout.unknowns):
        if isinstance(unknown, Modulus):
            name = f"bend_{specimen.section_below(specimen.segment(unknown.segment).to_m)}"
            if name in axes:
                # The gain is the recorded over the predicted bend: where it is large the segment is softer.
                values[index] -= float(np.clip(np.log(max(axes[name].gain, 1e-3)), -1.0, 1.0))
        for axis, letter in enumerate("xy"):
            sensor = unknown.name.removesuffix(f".bias_{letter}")
            if sensor != unknown.name and sensor in axes:
                values[index] = axes[sensor].bias[axis]
    return values


def with_bends_kept(specimen: Specimen, layout: Layout, sized: Floats, changed: Floats) -> Floats:
    """Change the gains as the moduli were changed, so that the bends keep their size."""
    values = changed.copy()
    moved = dict(zip(layout.names, changed - sized, strict=True))
    for chamber in specimen.chambers:
        if f"gain.{chamber.index}" in layout.names:
            ratio = np.exp(moved.get(f"modulus.{chamber.segment}", 0.0))
            values[layout.names.index(f"gain.{chamber.index}")] *= np.clip(ratio, 0.5, 2.0)
    return values
