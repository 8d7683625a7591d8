"""What a calibration must show to replace the old one, and cautions on one that does."""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.fit import CalibrationFit
from softarm.estimator.calibration.forward import NodePredictions
from softarm.estimator.calibration.layout import Layout
from softarm.estimator.calibration.nodes import BLOCK, Nodes
from softarm.estimator.calibration.outcome import Calibrated, Check
from softarm.estimator.calibration.setting import Setting
from softarm.estimator.calibration.significance import NODES_PER_FREEDOM, scatter_limit
from softarm.estimator.calibration.unknowns import Gain, Modulus
from softarm.estimator.effects.amounts import readable
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames

LEAST_PRESSURE_SPREAD = 1.0e3
"""Change of a pressure [Pa] below which a chamber shows nothing of its gain."""
LEAST_SOLVED = 0.5
"""Share of the nodes with an equilibrium, below which the unit of a pressure or a modulus is wrong."""
LARGEST_REMAINING_STEP = 1.0
"""Standard deviations by which an unknown may still move at the end."""
WORSE = 1.3
"""Times the old error up to which held-out samples may be predicted, where the old fit used them."""


class CalibrationRefusedError(InputError):
    """The recordings cannot carry a calibration; the old one stays."""

    def __init__(self, where: str, what: str, cure: str) -> None:
        super().__init__(where, what, f"{cure}; the old calibration stays")


class NotImprovedError(CalibrationRefusedError):
    """A fit predicts held-out samples worse than the old calibration."""


class MotionNotPredictedError(CalibrationRefusedError):
    """Whatever is fitted, the model predicts the motion no better than its mean does."""


def require_solutions(evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]) -> None:
    """Refuse recordings for which the model finds too few equilibria."""
    solved = np.concatenate([evaluation.converged for evaluation in evaluations])
    if solved.mean() < LEAST_SOLVED:
        raise CalibrationRefusedError(
            ", ".join(run_nodes.run.name for run_nodes in nodes),
            f"the model finds an equilibrium for {solved.mean():.0%} of the samples only",
            "check the pressures' unit and the specimen's moduli",
        )


def require_excitation(layout: Layout) -> None:
    """Refuse recordings that determine neither a modulus nor a gain."""
    if any(layout.of(Modulus) | layout.of(Gain)):
        return
    raise CalibrationRefusedError(
        "calibration", "the recordings determine neither a modulus nor a gain", Modulus.manoeuvre
    )


def require_convergence(solution: CalibrationFit, layout: Layout) -> None:
    """Refuse a fit of which an unknown still moves."""
    moves = solution.remaining_steps
    if moves.max(initial=0.0) > LARGEST_REMAINING_STEP:
        unknown = layout.unknowns[int(np.argmax(moves))]
        raise CalibrationRefusedError(
            "calibration",
            f"the fit does not converge: after {solution.iterations} iterations {unknown.name} would still "
            f"move by {moves.max():.1f} of its standard deviations",
            f"{unknown.manoeuvre}, and hold random poses",
        )


def require_improvement(check: Check, allowed: float) -> None:
    """Refuse a fit that predicts held-out samples worse than the old calibration.

    Args:
        check: How well both predict them.
        allowed: Ratio of the errors, pooled over the components, up to which the fit is kept.
    """
    if not check.held_out or not check.before:
        return
    ratio = _ratio(check.held_out, check.before)
    if ratio > allowed:
        raise NotImprovedError(
            "calibration",
            f"held-out samples are predicted worse than before, with {ratio:.3g} times the error",
            f"leave out recordings of an arm in another state, and record more poses, each held for 5 s in "
            f"recordings of more than {2.0 * BLOCK:.0f} s",
        )


def require_motion_predicted(
    setting: Setting, evaluations: Sequence[NodePredictions], nodes: Sequence[Nodes]
) -> None:
    """Refuse a fit that predicts moving readings no better than their mean does.

    Poses of an arm whose pressures rest, or of one without, show a modulus by where they are, not by motion.
    """
    pairs = [(part, one) for part, one in zip(evaluations, nodes, strict=True) if len(one.time)]
    suite = nodes[0].run.suite
    pressures = np.concatenate([one.pressures for _, one in pairs])
    driven = bool((np.ptp(pressures, axis=0) > LEAST_PRESSURE_SPREAD).any())
    if not driven or any(one.run.suite.slices != suite.slices for _, one in pairs):
        return
    first = pairs[0][0].response.at(np.zeros(1, dtype=np.int64)).frames
    measured = np.concatenate([_from_rest(setting, first, one) for _, one in pairs])
    left = np.concatenate([part.innovation for part, _ in pairs])
    read = np.isfinite(measured + left).any(axis=0)
    moved, remains = np.zeros((2, suite.size))
    moved[read] = np.nanvar(measured[:, read], axis=0)
    remains[read] = np.nanmean(left[:, read] ** 2, axis=0)
    ratios = {}
    for unit in dict.fromkeys(suite.units):
        rows = np.array([one == unit for one in suite.units]) & read
        if rows.any():
            ratios[unit] = np.sqrt([remains[rows].mean(), moved[rows].mean()]).tolist()
    if not ratios or min(after / max(before, 1e-12) for after, before in ratios.values()) < 1.0:
        return
    unit, (after, before) = next(iter(ratios.items()))
    factor, name = readable(unit)
    raise MotionNotPredictedError(
        "calibration",
        f"the model predicts the readings no better than their mean: they vary by {factor * before:.3g} "
        f"{name} rms, and the error of the model is {factor * after:.3g} {name}",
        "check that columns name the right chambers, sensors and units, and record larger motions",
    )


def _from_rest(setting: Setting, first: Frames, nodes: Nodes) -> Floats:
    """Return the readings relative to those of one pose of the arm, shape (nodes, rows)."""
    count = len(nodes.time)
    still = Frames(np.repeat(first.positions, count, axis=0), np.repeat(first.rotations, count, axis=0))
    return setting.aligned(nodes.run.suite).sensitivity(still, nodes.readings).innovation


def cautions(calibrated: Calibrated) -> tuple[str, ...]:
    """Return the cautions on a calibration that was not refused, one sentence each."""
    check, words = calibrated.check, []
    if calibrated.status != "converged":
        words.append(
            "The fit used all its iterations: unknowns may still move by up to their standard deviation."
        )
    if not check.held_out:
        return (
            *words,
            f"No sample was left out of the fit, so nothing checks it; record more than {2.0 * BLOCK:.0f} s, "
            "or several recordings.",
        )
    over_training = _ratio(check.held_out, check.training)
    freedom = calibrated.nodes / 2.0 / NODES_PER_FREEDOM
    limit = scatter_limit(freedom, freedom)
    if over_training > limit:
        words.append(
            f"Held-out samples are predicted with {over_training:.3g} times the error of "
            "the fitted samples; check that all recordings are of one arm in one state."
        )
    over_line = _ratio(check.held_out, check.line) if check.line else 0.0
    if over_line > limit:
        words.append(
            f"On these samples the error of the model is {over_line:.3g} times that of a linear regression "
            "on the pressures; check the axes of the sensors and the numbers of the chambers."
        )
    return tuple(words)


def _ratio(errors: Mapping[str, float], references: Mapping[str, float]) -> float:
    """Return the ratio of two errors, pooled over the components that both have."""
    shared = [name for name in errors if name in references]
    ratios = np.array([errors[name] / max(references[name], 1e-9) for name in shared])
    return float(np.sqrt((ratios**2).mean())) if shared else 0.0
