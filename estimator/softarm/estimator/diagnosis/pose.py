"""Where recordings see an arm: the calibrated model, corrected by what nominal recordings teach.

What an effect does depends on the pose, most of all where it begins at a place, as a wall or a slack cord
does. A wall that a section meets 20 mm deep is met 25 % deeper if the pose is 5 mm off, and a contact whose
depth is wrong by chance seems softer than it is. The corrections c of the predicted readings are learnt as
coefficients of columns; as strains s of the segments they are the mean of s ~ N(0, S) given
c = E s + N(0, R),

    s = S E' (E S E' + R)^-1 c,

with E the derivative of the readings by the segments' eigenstrains and R the noise.
"""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.unknowns import Alignment, BaseMount
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.nuisances import SCATTER
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.weights import Weights

STRAIN_STD = np.array([SCATTER.sizes["rad"]] * 3 + [SCATTER.sizes["m"]])
"""Error of the calibrated model in a segment's bends and twist [rad] and its elongation [m]."""


def with_poses(evidence: RegressionProblem, weights: Weights, prior: Gaussian) -> RegressionProblem:
    """Let effects see the arm of the recordings in question where nominal recordings show that it is.

    Args:
        evidence: All recordings.
        weights: Noise model.
        prior: Of the common coefficients, after nominal recordings.
    """
    if not evidence.has_nominal:
        return evidence
    moving = np.where(_moves_arm(evidence), prior.mean, 0.0)
    stages = []
    for stage, columns, names in zip(evidence.stages, evidence.columns, evidence.names, strict=True):
        if not stage.session.nominal:
            correction = np.asarray(columns @ moving, dtype=np.float64)
            noise = weights.stds(names)
            stage = replace(stage, observed=observed(stage, correction, noise))
        stages.append(stage)
    # What was kept is over the compliance before: that where effects see the arm counts as well now.
    return replace(evidence, stages=tuple(stages), kept={})


def observed(stage: Stage, correction: Floats, noise: Floats) -> Stage:
    """Move the arm of a session to where corrected predictions have it.

    Args:
        stage: The session.
        correction: Of the predicted readings, shape (samples, rows).
        noise: Standard deviation of each row, shape (rows,).
    """
    segments = stage.arm.segments.count
    by_strain = stage.by_eigenstrain
    spread = by_strain * np.tile(STRAIN_STD**2, segments)
    scatter = spread @ np.swapaxes(by_strain, 1, 2) + np.diag(noise**2)
    weighted = np.linalg.solve(scatter, correction[..., None])
    strains = (np.swapaxes(spread, 1, 2) @ weighted)[..., 0]
    return stage.moved(strains.reshape(len(strains), segments, 4))


def _moves_arm(evidence: RegressionProblem) -> Flags:
    """Return which common coefficients move the arm and not what sensors or the base make of it."""
    hooks = [evidence.library.hypotheses[d.hypothesis].effect.hook for d in evidence.library.directions]
    calibrated = [not isinstance(u, Alignment | BaseMount) for u in evidence.fitted.layout.unknowns]
    forms = [True] * (evidence.forms - 1) + [False]  # the last is the delay of the clocks
    return np.array([*calibrated, *forms, *(hook not in ("sensing", "support") for hook in hooks)])
