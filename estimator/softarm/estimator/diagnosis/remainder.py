"""What accepted effects leave of the recordings in question, with its normal equations."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.fit import (
    Fit,
    MarginalisedProblem,
    Parametrisation,
    RecordingResidual,
    change_by,
    differentiated,
    placed_effects,
    placed_in,
)
from softarm.estimator.diagnosis.folds import Folds
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.marginal import Marginal
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.weights import Weights

KEPT = 4
"""Largest number of remainders that a search keeps: with its folds, one of ten minutes takes 0.1 GB."""


@dataclass(frozen=True, eq=False)
class Remainder:
    """What accepted effects leave.

    Args:
        evidence: Residuals and columns of all recordings.
        weights: Noise model.
        prior: Of the coefficients of ``columns``.
        fit: The accepted effects; ``None`` where there are none.
        residuals: What they leave of each session, shape (samples, rows); nominal recordings have none of
            them.
        parts: Normal equations of the stretches in question.
    """

    evidence: RegressionProblem
    weights: Weights
    prior: Gaussian
    fit: Fit | None
    residuals: list[Floats]
    parts: list[NormalEquations]

    @classmethod
    def of(
        cls, evidence: RegressionProblem, weights: Weights, prior: Gaussian, fit: Fit | None
    ) -> "Remainder":
        """Take the change by accepted effects off all residuals."""
        residuals = [
            residual if fit is None or stage.session.nominal else residual - change_by(stage, fit)
            for stage, residual in zip(evidence.stages, evidence.residuals, strict=True)
        ]
        products = evidence.products(weights, residuals)
        return cls(evidence, weights, prior, fit, residuals, [one for one in products if not one.nominal])

    @cached_property
    def searched(self) -> list[NormalEquations]:
        """Those of the stretches that a fit may see."""
        return [part for part in self.parts if not part.heldout]

    @cached_property
    def folds(self) -> Folds:
        """The searched stretches, together and as folds."""
        return Folds.of(self.searched, self.prior, self.weights.effective_sample_fraction)

    @cached_property
    def marginal(self) -> Marginal:
        """What the searched stretches show of every column."""
        return Marginal.of(self.folds.whole)

    def columns(self, number: int) -> NDArray[np.float32]:
        """Return the common columns of a session, shape (samples, rows, columns)."""
        return self.evidence.columns[number]

    def new_columns(self, more: Callable[[Stage], Floats]) -> list[NewColumns]:
        """Return the products of new columns, shape (samples, rows, new), in the searched stretches."""
        return self.evidence.with_columns(self.weights, more, self.searched, self.residuals)

    def problem(self) -> MarginalisedProblem:
        """Prepare nonlinear fits on the searched stretches."""
        weighted = []
        for number, stage in enumerate(self.evidence.stages):
            session = stage.session
            if session.nominal or session.heldout.all():
                continue
            residual = self.residuals[number]
            used = np.isfinite(residual) & ~session.heldout[:, None]
            weight = used / self.evidence.scale(self.weights, number)
            common = self.columns(number)[used] * weight[used][:, None].astype(np.float32)
            scaled = np.nan_to_num(residual) * weight
            weighted.append(RecordingResidual(stage, scaled, weight, common, placed_in(stage, self.fit)))
        return MarginalisedProblem(tuple(weighted), self.folds.whole)


@dataclass(frozen=True, eq=False)
class FreeSizes(Remainder):
    """What accepted effects leave where their parameters stay free, to first order.

    An effect that stands for a part of another one as well would otherwise hide it: creep that has also taken
    what a sensor reads too little, or a force the weight of a payload.
    """

    fit: Fit

    @classmethod
    def beside(cls, left: Remainder, fit: Fit) -> "FreeSizes":
        """Add columns for the parameters of accepted effects to what these leave."""
        prior, parametrisation = left.prior, Parametrisation.of(fit.hypotheses)
        pulls = parametrisation.centres - parametrisation.units(np.concatenate(fit.thetas))
        for pull, spread in zip(pulls.tolist(), parametrisation.spreads.tolist(), strict=True):
            prior = prior.augment(pull, spread**2)
        return cls(left.evidence, left.weights, prior, fit, left.residuals, left.parts)

    @cached_property
    def slopes(self) -> dict[int, Floats]:
        """Derivatives of each session by the parameters in units of the fit, by identity of its stage.

        Of shape (samples, rows, parameters), and zero in nominal recordings.
        """
        fit, parametrisation = self.fit, Parametrisation.of(self.fit.hypotheses)
        values = parametrisation.units(np.concatenate(fit.thetas))
        slopes = {}
        for stage in self.evidence.stages:

            def changed(thetas: Sequence[Floats], stage: Stage = stage) -> list[Floats]:
                return [stage.change(placed_effects(stage, fit.hypotheses, thetas))]

            slope = np.zeros((*stage.residual.shape, len(values)))
            if not stage.session.nominal:
                (slope,) = differentiated(parametrisation, values, changed, changed(fit.thetas))
            slopes[id(stage)] = np.nan_to_num(slope)
        return slopes

    @cached_property
    def folds(self) -> Folds:
        """The searched stretches, with columns for the parameters."""
        new = super().new_columns(lambda stage: self.slopes[id(stage)])
        bordered = [part.bordered(own) for part, own in zip(self.searched, new, strict=True)]
        return Folds.of(bordered, self.prior, self.weights.effective_sample_fraction)

    def columns(self, number: int) -> NDArray[np.float32]:
        """Return the common columns of a session and those for the parameters."""
        slopes = self.slopes[id(self.evidence.stages[number])].astype(np.float32)
        return np.concatenate([self.evidence.columns[number], slopes], axis=-1)

    def new_columns(self, more: Callable[[Stage], Floats]) -> list[NewColumns]:
        """Return the products of new columns with the common ones and those for the parameters."""

        def both(stage: Stage) -> Floats:
            return np.concatenate([self.slopes[id(stage)], more(stage)], axis=-1)

        count = sum(len(theta) for theta in self.fit.thetas)
        return [new.beside_first(count) for new in super().new_columns(both)]
