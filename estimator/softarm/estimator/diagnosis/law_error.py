"""What the errors of effects' laws do to other effects, and to sizes.

No law is exact: of what an effect changes it gets a share wrong, which differs between recordings and
channels. What one law leaves of a strong effect looks like a second effect. So beside an effect that changes
the prediction by f, each recording and channel may have any multiple d f of that, with d normal about 0 with
standard deviation ``SHARE``: columns as those of the common coefficients, and marginalised with them. A size
is less certain by the error of its own law.
"""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.fit import Fit, MarginalisedProblem, whitened

SHARE = 0.3
"""What laws get wrong of the changes that they explain: the share of the mismatch on unseen data that rightly
named effects leave, median over the single effects of blind trials (``bench diagnosis``)."""


def gain_beside_law_errors(problem: MarginalisedProblem, fit: Fit, number: int) -> float:
    """Return by how much an effect of a fit lowers the cost where the laws of all others err.

    Args:
        problem: What the effects were fitted to.
        fit: All effects; the others stay as they are, but for the error of their laws.
        number: The effect.
    """
    others = [k for k in range(len(fit.thetas)) if k != number]
    whole, rest = _changes(problem, fit, range(len(fit.thetas))), _changes(problem, fit, others)
    own_sensor = fit.hypotheses[number].place.sensor
    erring = [k for k in others if fit.hypotheses[k].place.sensor in (None, own_sensor)]
    columns = [np.column_stack([all_ - other, other]) for all_, other in zip(whole, rest, strict=True)]
    matrix, vector = beside_law_errors(problem, columns, fit, erring)
    return float(2.0 * (vector[0] - matrix[0, 1]) - matrix[0, 0])


def beside_law_errors(
    problem: MarginalisedProblem, columns: Sequence[Floats], fit: Fit, erring: Sequence[int]
) -> tuple[Floats, Floats]:
    """Return M and b of whitened columns as ``projected`` does, with the errors of laws marginalised as well.

    Args:
        problem: What is fitted to.
        columns: Of each recording, shape (samples * channels, k).
        fit: Effects.
        erring: Numbers of those whose laws err.
    """
    errors = [_changes(problem, fit, [number]) for number in erring]
    k = columns[0].shape[1]
    count = sum(recorded.residual.shape[1] for recorded in problem.residuals) * len(errors)
    widened, first = [], k
    for number, (recorded, own) in enumerate(zip(problem.residuals, columns, strict=True)):
        wide = np.zeros((len(own), k + count))
        wide[:, :k] = own
        channels = recorded.residual.shape[1]
        for error in errors:
            # One column for each channel, in which all others are zero.
            diagonal = error[number].reshape(-1, channels, 1) * np.eye(channels)
            wide[:, first : first + channels] = diagonal.reshape(-1, channels)
            first += channels
        widened.append(wide)
    matrix, vector = problem.projected(widened)
    known = matrix[k:, k:] + np.eye(count) / SHARE**2
    absorbed = np.linalg.solve(known, np.column_stack([matrix[k:, :k], vector[k:]]))
    across = matrix[:k, k:]
    return matrix[:k, :k] - across @ absorbed[:, :-1], vector[:k] - across @ absorbed[:, -1]


def gradient_covariance(problem: MarginalisedProblem, fit: Fit, slopes: Sequence[Floats]) -> Floats:
    """Compute the covariance of the gradient of least squares that comes from the errors of laws.

    It is the sum of X'd d'X, with d the change by an effect in one channel of one recording, times ``SHARE``.
    How a sensor is mounted, scaled or late is kinematics, which is exact.

    Args:
        problem: What the effects were fitted to.
        fit: The effects.
        slopes: X, the changes by each parameter, of each recording, shape (samples * channels, parameters).

    Returns:
        Shape (parameters, parameters).
    """
    count = slopes[0].shape[1]
    covariance = np.zeros((count, count))
    for number, hypothesis in enumerate(fit.hypotheses):
        if hypothesis.effect.hook == "sensing":
            continue
        changes = _changes(problem, fit, [number])
        for recorded, slope, change in zip(problem.residuals, slopes, changes, strict=True):
            channels = recorded.residual.shape[1]
            by_channel = change[:, 0].reshape(-1, channels)
            by_error = np.einsum("tcp,tc->cp", slope.reshape(-1, channels, count), by_channel)
            covariance += SHARE**2 * by_error.T @ by_error
    return covariance


def _changes(problem: MarginalisedProblem, fit: Fit, chosen: Sequence[int]) -> list[Floats]:
    """Return what some effects of a fit change, as ``whitened`` does."""
    hypotheses, thetas = [fit.hypotheses[k] for k in chosen], [fit.thetas[k] for k in chosen]
    return whitened(problem, hypotheses, thetas, exact=fit.exact)
