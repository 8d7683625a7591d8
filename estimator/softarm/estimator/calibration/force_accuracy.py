"""How far estimated forces err at the nodes of known pulls that were held out of the fit.

A pull f on a section and the pressures p move the readings by J_f f + J_p p. About the prediction under the
known pull, an estimator explains the residual r, measured minus predicted, by a force: the error of the
estimate is e = A^-1 b with b = J_f' C^-1 r, A = J_f' C^-1 J_f and C the noise of the sensors with the model's
scatter and, through J_p, of the pressures.

Part of it grows with the pull. Rubber remembers, and its stiffness depends on the direction, so that the
stiffness that fits all other pulls is wrong by another share in each: e = S f + rest, with S a share along
the pull and one across it, by least squares over the nodes of one pull. The rest has the covariance A^-1
where r has the covariance C: then e' A e is 1 a component on average. What rubber remembers is in all nodes
of a pull, so that pulls, not nodes, are the independent samples; their small number enters by Student's t.

On sections that nobody pulled, the rest of r at pulls on other sections stands for a force.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.load_equations import load_equations, load_readings
from softarm.estimator.calibration.nodes import Nodes
from softarm.estimator.calibration.pulls import LEAST_PULL
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.significance import student_factor
from softarm.estimator.sensing.model_error import (
    ON,
    PRESSURISED_PULLS,
    VENTED_PULLS,
    Condition,
    ModelError,
    vented,
)

LATERAL = 2  # components of a pull that are estimated, along x and y
PULLED = 3  # components of a pull that are known


@dataclass(frozen=True)
class ForceAccuracy:
    """How far estimated forces err, each by condition and section, such as ``vented pulls on tip``.

    Twice either holds 95 % of the errors, as twice a standard deviation does.

    Args:
        ratios: Error that does not grow with the force, over its deviation.
        errors: Relative error of a force on a section that was pulled.
    """

    ratios: Mapping[str, float]
    errors: Mapping[str, float]


@dataclass(frozen=True)
class _Pull:
    """The nodes of one pull.

    Args:
        section: On which it acts.
        sections: On which forces may be estimated, three components each.
        directions: The pull and what is across it, columns, shape (nodes, 2, 2).
        information: J' C^-1 J of the forces on all sections, shape (nodes, forces, forces).
        innovation: J' C^-1 r, shape (nodes, forces).
        weights: Of the nodes, shape (nodes,).
    """

    section: str
    sections: tuple[str, ...]
    directions: Floats
    information: Floats
    innovation: Floats
    weights: Floats

    def lateral(self, section: str) -> slice:
        """Return the lateral components of a section among the forces."""
        first = PULLED * self.sections.index(section)
        return slice(first, first + LATERAL)

    @cached_property
    def growth(self) -> Floats:
        """J' C^-1 J_f of what grows with the pull along and across it, shape (nodes, forces, 2)."""
        return np.asarray(self.information[:, :, self.lateral(self.section)] @ self.directions)

    @cached_property
    def shares(self) -> tuple[Floats, Floats]:
        """Relative error along and across, shape (2,), and the normal equations' matrix, shape (2, 2)."""
        there = self.lateral(self.section)
        onto = self.weights[:, None, None] * np.swapaxes(self.directions, 1, 2)
        normal = (onto @ self.growth[:, there]).sum(axis=0)
        return np.linalg.solve(normal, (onto @ self.innovation[:, there, None]).sum(axis=0)[:, 0]), normal

    def squares(self, section: str) -> Floats:
        """Return e' A e of what does not grow with the pull, shape (nodes,); NaN where nothing shows it."""
        there = self.lateral(section)
        rest = (self.innovation - self.growth @ self.shares[0])[:, there, None]
        information, squares = self.information[:, there, there], np.full(len(rest), np.nan)
        shown = np.linalg.matrix_rank(information) == LATERAL
        e = np.linalg.solve(information[shown], rest[shown])
        squares[shown] = (rest[shown] * e).sum(axis=(1, 2))
        return squares


def force_accuracy(
    setting: Setting,
    evaluations: Sequence[NodePredictions],
    nodes: Sequence[Nodes],
    scatter: Mapping[str, float],
) -> ForceAccuracy:
    """Compute the errors of forces that are estimated at known pulls.

    Nodes count by their weight: a cord that moves does not pull as in an equilibrium.

    Args:
        setting: The calibration.
        evaluations: What it predicts, per run.
        nodes: The nodes that it predicts, best held-out ones; each pull is a block.
        scatter: About its predictions, by sensor, quantity and condition [m or rad].
    """
    error = ModelError.of(scatter)
    ratios: dict[str, float] = {}
    errors: dict[str, float] = {}
    for name, condition in ((VENTED_PULLS, error.vented), (PRESSURISED_PULLS, error.pressurised)):
        pulls: list[_Pull] = []
        for at, run_nodes in zip(evaluations, nodes, strict=True):
            chosen = vented(run_nodes.pressures) == (name == VENTED_PULLS)
            chosen &= (np.abs(run_nodes.loads) > LEAST_PULL).any(axis=1) & at.converged
            for block in np.unique(run_nodes.blocks[chosen]):
                one = chosen & (run_nodes.blocks == block)
                pulls += _pull(setting, at.keep(one), run_nodes.keep(one), condition)
        for section in pulls[0].sections if pulls else ():
            on_it = [pull for pull in pulls if pull.section == section]
            where = f"{name}{ON}{section}"
            if on_it:
                errors[where] = _relative_error(on_it)
            ratio = _ratio(on_it or pulls, section)
            if np.isfinite(ratio):
                ratios[where] = ratio
    return ForceAccuracy(ratios, errors)


def _relative_error(pulls: Sequence[_Pull]) -> float:
    shares = [pull.shares for pull in pulls]
    square = sum(float(share @ normal @ share) for share, normal in shares)
    return _widened(square / sum(float(np.trace(normal)) for _, normal in shares), pulls)


def _widened(mean_square: float, pulls: Sequence[_Pull]) -> float:
    """Return the root mean square over pulls, of which each has two components, by Student's t."""
    return float(np.sqrt(mean_square)) * student_factor(LATERAL * len(pulls))


def _ratio(pulls: Sequence[_Pull], section: str) -> float:
    """Return the ratio; NaN where no nodes are left beside the shares that were fitted."""
    squares = np.concatenate([pull.squares(section) for pull in pulls])
    weights = np.concatenate([pull.weights for pull in pulls])
    shown = np.isfinite(squares)
    free = shown.sum() - len(pulls)
    if free <= 0:
        return float("nan")
    mean = float(np.average(squares[shown], weights=weights[shown])) / LATERAL
    return _widened(mean * shown.sum() / free, pulls)


def _pull(setting: Setting, at: NodePredictions, run_nodes: Nodes, condition: Condition) -> list[_Pull]:
    """Return one pull, without the nodes at which no reading shows it or only the axis is pulled; or none."""
    to_loads, noise = load_readings(setting, at, run_nodes, condition.scatter)
    pulled = setting.pulls(run_nodes.loads)
    # Three components a section: that of the largest is the section pulled on.
    first = int(np.argmax(np.abs(pulled).max(axis=0))) // PULLED * PULLED
    axial = first + LATERAL
    # The estimate has no axial load: what the prediction owes to that component is missing from it.
    missed = at.innovation + to_loads[:, :, axial] * pulled[:, axial, None]
    information, innovation = load_equations(to_loads, noise, missed)
    there = slice(first, axial)
    shown = np.linalg.matrix_rank(information[:, there, there]) == LATERAL
    shown &= np.linalg.norm(pulled[:, there], axis=1) > LEAST_PULL
    if not shown.any():
        return []
    x, y = pulled[shown, first], pulled[shown, first + 1]
    names = tuple(name.rpartition("_")[0] for name in run_nodes.run.load_names[::PULLED])
    return [
        _Pull(
            names[first // PULLED],
            names,
            np.stack([np.stack([x, -y], axis=1), np.stack([y, x], axis=1)], axis=1),
            information[shown],
            innovation[shown],
            run_nodes.weights[shown],
        )
    ]
