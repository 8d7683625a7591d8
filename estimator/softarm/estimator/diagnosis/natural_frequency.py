"""The frequency at which a released arm vibrates: one more measurement, of mass and stiffness, not of weight.

With k the stiffness of the tip and m the modal mass, omega^2 = k / m. In nominal recordings k is the
model's and omega is seen, so m follows; what an effect does to k or m then predicts the frequency in the
recordings in question. A force or a tilt changes neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.fit import Fit, Parametrisation
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.stage import Stage

SIGMA = 0.015
"""Standard deviation of the logarithm of a ratio of frequencies."""
ONE_POSE = 0.05
"""Share of a size that one pose at rest leaves open: the model's law was calibrated at another load."""
ROUNDING = 1e-12
"""Least variance of a combination of parameters, over the largest."""


@dataclass(frozen=True)
class NaturalFrequency:
    """Natural frequencies of a released arm.

    Args:
        ratio: Logarithm of the frequency in question over that of nominal recordings.
        mass: Modal mass in nominal recordings, gathered at the tip [kg].
    """

    ratio: float
    mass: float

    def predicted(self, hypotheses: Sequence[Hypothesis], thetas: Sequence[Floats]) -> float:
        """Return the logarithm of the ratio that effects predict."""
        mass, stiffness = self.mass, 1.0
        for hypothesis, theta in zip(hypotheses, thetas, strict=True):
            change = hypothesis.effect.modal(theta)
            mass = mass * change.mass_ratio + change.added_mass
            stiffness *= change.stiffness_ratio
        return 0.5 * float(np.log(max(stiffness, 1e-6) * self.mass / max(mass, 1e-6)))

    def gain(self, predicted: float) -> float:
        """Return by how much a prediction lowers the cost against none."""
        return float((self.ratio**2 - (self.ratio - predicted) ** 2) / SIGMA**2)

    def gain_of(self, fit: Fit | None) -> float:
        """Return by how much a fit lowers the cost against none."""
        return self.gain(self.predicted(fit.hypotheses, fit.thetas)) if fit is not None else 0.0

    def conditioned(self, fit: Fit) -> Fit:
        """Condition a fit, and its gain, on the frequency: the mode of the posterior, in bounds.

        The unknowns are changes of the parameters in units of the fit; the residual is these changes,
        whitened, then that of the frequency.
        """
        size = fit.covariance.shape[0]
        sizes = [len(theta) for theta in fit.thetas]
        fixed, before = np.split(np.concatenate(fit.thetas), [sum(sizes) - size])
        parameters = Parametrisation.of(fit.hypotheses).parameters[-size:]
        unfixed = Parametrisation(parameters, (size,))
        scale = unfixed.slopes(unfixed.units(before))
        values, vectors = np.linalg.eigh(fit.covariance + np.diag((ONE_POSE * before / scale) ** 2))
        whitener = vectors / np.sqrt(np.maximum(values, ROUNDING * values[-1]))

        def parts(change: Floats) -> list[Floats]:
            return np.split(np.concatenate([fixed, before + scale * change]), np.cumsum(sizes)[:-1])

        def residual(change: Floats) -> Floats:
            innovation = self.ratio - self.predicted(fit.hypotheses, parts(change))
            return np.append(change @ whitener, innovation / SIGMA)

        lower, upper = np.array([(p.lower, p.upper) for p in parameters]).T
        least, most = np.sort([(lower - before) / scale, (upper - before) / scale], axis=0)
        bounds = np.minimum(least, 0.0), np.maximum(most, 0.0)
        solution = least_squares(residual, np.zeros(size), bounds=bounds, x_scale=np.sqrt(values.max()))
        thetas = tuple(parts(solution.x))
        total = self.gain(self.predicted(fit.hypotheses, thetas)) - float(
            solution.fun[:-1] @ solution.fun[:-1]
        )
        covariance = np.linalg.inv(solution.jac.T @ solution.jac)
        return replace(fit, thetas=thetas, covariance=covariance, gain=fit.gain + total)


def natural_frequency_of(stages: Sequence[Stage]) -> NaturalFrequency | None:
    """Compare the frequencies of recordings in question and nominal ones; ``None`` where either lack one."""
    frequencies = {
        nominal: [f for s in stages if (f := s.session.natural_frequency) and s.session.nominal == nominal]
        for nominal in (True, False)
    }
    if not frequencies[True] or not frequencies[False]:
        return None
    nominal_hz, questioned_hz = float(np.median(frequencies[True])), float(np.median(frequencies[False]))
    stage = next(stage for stage in stages if stage.session.nominal)
    mass = 1.0 / (_compliance(stage) * (2.0 * np.pi * nominal_hz) ** 2)
    return NaturalFrequency(float(np.log(questioned_hz / nominal_hz)), mass)


def _compliance(stage: Stage) -> float:
    """Return the largest compliance of the tip against a force across the arm [m/N]."""
    response = stage.arm.baseline
    sections = response.frames.positions.shape[1]
    tip = 6 * (sections - 1)
    block = response.load_jacobian[0, tip : tip + 2, tip : tip + 2]
    return float(np.linalg.eigvalsh(0.5 * (block + block.T))[-1])
