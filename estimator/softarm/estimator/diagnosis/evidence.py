"""The recordings of a diagnosis as residuals and columns, and their products under a noise model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.library import Library
from softarm.estimator.diagnosis.normal_equations import (
    NewColumns,
    NormalEquations,
    normal_equations,
    renewed,
    total,
    with_columns,
)
from softarm.estimator.diagnosis.nuisances import Nuisances
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage, fading
from softarm.estimator.diagnosis.weights import Weights, weights_of
from softarm.estimator.specimen.physics import EffectName

Singles = NDArray[np.float32]

FULLEST = 5.0
"""Spread, in typical sizes, of all effects at once in the fullest model, which determines the noise."""
QUIET = 25.0
"""Percentile of the recordings' noise that counts as the sensor's: where an arm vibrates it seems larger."""
INADEQUACY = 0.004
"""Share of the motion that no model of an arm gets right, however much is fitted."""
RELATIVE_MODEL_ERROR = 0.1
"""Share of a mismatch that the best law for it still gets wrong, so that no few samples decide a search."""
NOVELTY = 2.0
"""Largest scatter of the recordings in question over that of nominal ones."""
BACKGROUND = 0.3
"""Spread of what every arm may have of an effect, in typical sizes: the prior before nominal recordings."""
ABSENT = 0.01
"""Share of it for effects that no arm has of itself, which nominal runs need not have come near."""


@dataclass(frozen=True)
class RegressionProblem:
    """Residuals and columns of all sessions.

    Args:
        specimen: Name of the specimen.
        stages: The sessions on the calibrated model.
        fitted: The calibration, whose unknowns are the first columns.
        library: Directions: the columns after them.
        residuals: Of each session, shape (samples, rows).
        columns: Of each session, shape (samples, rows, unknowns + forms + directions).
        forms: Number of columns of the model form.
        kept: Normal equations under the last noise model, by its scales.
    """

    specimen: str
    stages: tuple[Stage, ...]
    fitted: Nuisances
    library: Library
    residuals: tuple[Floats, ...]
    columns: tuple[Singles, ...]
    forms: int
    kept: dict[tuple[tuple[str, float], ...], list[list[NormalEquations]]] = field(
        default_factory=dict, compare=False
    )

    @property
    def nuisances(self) -> int:
        """Number of columns of calibration and model form."""
        return self.calibrations + self.forms

    @property
    def calibrations(self) -> int:
        """Number of columns of the calibration."""
        return len(self.fitted.values)

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.nuisances + len(self.library.directions)

    @property
    def has_nominal(self) -> bool:
        """Whether any session shows the arm in its known state."""
        return any(stage.session.nominal for stage in self.stages)

    @property
    def effects(self) -> list[EffectName]:
        """Effect of each direction."""
        return [self.library.hypotheses[direction.hypothesis].name for direction in self.library.directions]

    @property
    def names(self) -> list[tuple[str, ...]]:
        """Channels of each session."""
        return [channels(stage.suite) for stage in self.stages]

    @cached_property
    def typical(self) -> Floats:
        """Standard deviation of each coefficient before any recording, effects in typical sizes."""
        return np.asarray(np.sqrt(np.diag(self.prior(1.0, 1.0).covariance)), dtype=np.float64)

    def prior(self, background: float, form: float) -> Gaussian:
        """Return the prior before any recording.

        Args:
            background: Standard deviation of each direction's coefficient in typical sizes.
            form: Standard deviation of the coefficients of the model form, in their spread.
        """
        known, rows = self.fitted.prior_rows()
        covariance = np.zeros((self.size, self.size))
        count = self.calibrations
        covariance[:count, :count] = np.linalg.inv(rows.T @ rows)
        forms = np.arange(count, self.nuisances)
        covariance[forms, forms] = form**2
        covariance[self.nuisances - 1, self.nuisances - 1] = 1.0  # the clocks are unknown whatever is assumed
        effect_columns = np.arange(self.nuisances, self.size)
        covariance[effect_columns, effect_columns] = background**2
        mean = np.zeros(self.size)
        # It pulls towards what was known beforehand, not towards the values at which residuals are taken.
        mean[:count] = np.linalg.lstsq(rows, known, rcond=None)[0]
        return Gaussian(mean, covariance)

    def sound(self) -> Gaussian:
        """Return the prior of an arm that is well, before any recording; see ``prior``."""
        prior = self.prior(BACKGROUND, 1.0)
        in_healthy_arms = [
            self.library.hypotheses[d.hypothesis].effect.in_healthy_arms for d in self.library.directions
        ]
        size = np.concatenate([np.ones(self.nuisances), np.where(in_healthy_arms, 1.0, ABSENT)])
        return Gaussian(prior.mean, prior.covariance * np.outer(size, size))

    def products(self, weights: Weights, residuals: Sequence[Floats] | None = None) -> list[NormalEquations]:
        """Multiply residuals and columns, stretch by stretch; the columns' own products are kept."""
        key = tuple(sorted(weights.scale.items()))
        if key not in self.kept:
            self.kept.clear()
            self.kept[key] = [self._first(weights, number) for number in range(len(self.stages))]
        if residuals is None:
            return [part for parts in self.kept[key] for part in parts]
        products = []
        for number, stage in enumerate(self.stages):
            scale, blocks = self.scale(weights, number), stage.session.blocks
            products += renewed(
                self.kept[key][number], residuals[number], self.columns[number], scale, blocks
            )
        return products

    def with_columns(
        self,
        weights: Weights,
        more: Callable[[Stage], Floats],
        parts: Sequence[NormalEquations],
        residuals: Sequence[Floats] | None = None,
    ) -> list[NewColumns]:
        """Multiply new columns in some stretches, in their order: session by session.

        Args:
            weights: Noise model.
            more: The new columns of a session, shape (samples, rows, new).
            parts: Normal equations of the stretches.
            residuals: Of each session; those without effects when left out.
        """
        residual = self.residuals if residuals is None else residuals
        products: list[NewColumns] = []
        for number, stretches in groupby(parts, key=lambda part: part.session):
            stage = self.stages[number]
            scale, blocks = self.scale(weights, number), stage.session.blocks
            products += with_columns(
                list(stretches), residual[number], self.columns[number], more(stage), scale, blocks
            )
        return products

    def scale(self, weights: Weights, number: int) -> Floats:
        """Return the standard deviation of each residual of a session, shape (samples, rows)."""
        stage = self.stages[number]
        row = weights.stds(channels(stage.suite))
        std: Floats = np.hypot(stage.error_std(row), self._mismatch_error_std[number])
        return std

    @cached_property
    def _mismatch_error_std(self) -> list[Floats]:
        """What a change of the model gets wrong of a mismatch of some size, each of shape (samples, rows).

        A share of it, and what is of second order: half the square of an angle, by Taylor's theorem.
        """
        errors = []
        for stage in self.stages:
            groups, sizes = _groups(stage), np.nan_to_num(np.abs(stage.residual))
            largest = {
                group: sizes[:, [k for k, own in enumerate(groups) if own == group]].max(axis=1)
                for group in groups
            }
            mismatch = np.stack([largest[group] for group in groups], axis=1)
            curved = 0.5 * mismatch**2 / stage.lever
            for order in (1, -1):  # a swing differs before it differs most, and after
                curved = fading(order * stage.session.clock[::order], curved[::order])[::order]
            errors.append(np.hypot(RELATIVE_MODEL_ERROR * mismatch, curved))
        return errors

    def _first(self, weights: Weights, number: int) -> list[NormalEquations]:
        session = self.stages[number].session
        return normal_equations(
            self.residuals[number],
            self.columns[number],
            self.scale(weights, number),
            session.blocks,
            session.heldout,
            session.reported,
            number,
            nominal=session.nominal,
        )

    def weigh(self) -> Weights:
        """Learn the noise model from what the fullest model leaves outside the held-out stretches.

        What something missing leaves in the recordings in question must not count as their noise: where
        there are nominal ones, it is at most ``NOVELTY`` times the noise of these.
        """
        weights = self._weights(self.residuals, range(len(self.stages)))
        for _ in range(2):
            each = [self._fullest(weights, self.residuals, nominal=nominal) for nominal in (True, False)]
            residuals = [each[0 if s.session.nominal else 1][k] for k, s in enumerate(self.stages)]
            calmed = self._calmed(residuals, weights)
            weights = self._weights(calmed, range(len(self.stages)))
            nominal = [k for k, stage in enumerate(self.stages) if stage.session.nominal]
            if nominal:
                weights = weights.bounded(self._weights(calmed, nominal), NOVELTY)
        return weights

    def _weights(self, residuals: Sequence[Floats], chosen: Sequence[int]) -> Weights:
        observed = self._observed(residuals)
        names, sigmas = self.names, self._sigmas
        return weights_of(
            [names[k] for k in chosen], [observed[k] for k in chosen], [sigmas[k] for k in chosen]
        )

    def _calmed(self, residuals: Sequence[Floats], weights: Weights) -> list[Floats]:
        """Shrink residuals by what the error of the model adds to their scatter."""
        shrunk = []
        for number, (stage, residual) in enumerate(zip(self.stages, residuals, strict=True)):
            row = weights.stds(channels(stage.suite))
            shrunk.append(residual * row / self.scale(weights, number))
        return shrunk

    def leftover(self, weights: Weights, residuals: Sequence[Floats], *, nominal: bool) -> float:
        """Return the rms, over its scatter, of what everything at once leaves of some recordings."""
        shrunk = self._calmed(self._fullest(weights, residuals, nominal=nominal), weights)
        squares = [
            (residual[~stage.session.heldout] / weights.stds(names)).ravel() ** 2
            for stage, residual, names in zip(self.stages, shrunk, self.names, strict=True)
            if stage.session.nominal == nominal
        ]
        return float(np.sqrt(np.nanmean(np.concatenate(squares)))) if squares else 0.0

    def _fullest(self, weights: Weights, residuals: Sequence[Floats], *, nominal: bool) -> list[Floats]:
        """Return what everything at once leaves of nominal, or other, recordings, widened by what it fits.

        It fits independent samples, of which there are fewer than samples. Beside nominal recordings, which
        last minutes, all count: what is left of unchanged arms is less than the noise as it is.
        """
        every = self.products(weights, residuals)
        parts = [p for p in every if not p.heldout and p.nominal == nominal]
        if not parts:
            return list(residuals)
        everything = total(parts, self.size)
        fraction = 1.0 if self.has_nominal else weights.effective_sample_fraction
        posterior = self.prior(FULLEST, FULLEST).posterior(everything, fraction)
        spent = fraction * float(np.einsum("ij,ji->", posterior.covariance, everything.matrix))
        count = fraction * everything.count
        widen = np.sqrt(count / max(count - spent, 0.1 * count))
        return [
            widen * (residual - c @ posterior.mean) if stage.session.nominal == nominal else residual
            for stage, residual, c in zip(self.stages, residuals, self.columns, strict=True)
        ]

    @cached_property
    def floors(self) -> dict[str, float]:
        """Noise of each channel, as the quieter recordings show it [m, rad]."""
        noise: dict[str, list[float]] = {}
        for stage, names in zip(self.stages, self.names, strict=True):
            for name, sigma in zip(names, stage.session.sigma.tolist(), strict=True):
                noise.setdefault(name, []).append(sigma)
        return {name: float(np.percentile(sigmas, QUIET)) for name, sigmas in noise.items()}

    @cached_property
    def _sigmas(self) -> list[Floats]:
        """Noise of each row, and what no model of an arm gets right of its motion."""
        squares: dict[tuple[str, str], list[Floats]] = {}
        groups = [_groups(stage) for stage in self.stages]
        for stage, own in zip(self.stages, groups, strict=True):
            readings = stage.reading_rows[~stage.session.heldout]
            for group, column in zip(own, readings.T, strict=True):
                squares.setdefault(group, []).append(column[np.isfinite(column)] ** 2)
        # A body that moves along one axis is off along all: a group's channels share the largest motion.
        form: dict[tuple[str, str], float] = {}
        for group, parts in squares.items():
            moved = max(float(part.mean()) if len(part) else 0.0 for part in parts)
            form[group] = INADEQUACY * float(np.sqrt(moved))
        noise = [np.array([self.floors[name] for name in own]) for own in self.names]
        return [
            np.hypot(floor, [form[group] for group in own]) for floor, own in zip(noise, groups, strict=True)
        ]

    def _observed(self, residuals: Sequence[Floats]) -> list[Floats]:
        return [
            residual[~stage.session.heldout] for stage, residual in zip(self.stages, residuals, strict=True)
        ]


def _groups(stage: Stage) -> list[tuple[str, str]]:
    """Return sensor and unit of each row."""
    names = (name.rpartition(".")[0] for name in channels(stage.suite))
    return list(zip(names, stage.suite.units, strict=True))
