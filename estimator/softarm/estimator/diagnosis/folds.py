"""Folds of the searched stretches, with all that is common to the recordings marginalised."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.marginal import Combinations, Marginaliser
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations, Total, added, total

Fold = tuple[Total, Total]
"""Normal equations of new columns in a fold, and in all others."""


@dataclass(frozen=True)
class Folds:
    """The searched stretches, together and as folds.

    Args:
        numbers: Of the stretches of each fold.
        whole: All stretches.
        own: Those of each fold.
        rest: All others, for each fold.
    """

    numbers: tuple[tuple[int, ...], ...]
    whole: Marginaliser
    own: tuple[Marginaliser, ...]
    rest: tuple[Marginaliser, ...]

    @classmethod
    def of(cls, parts: Sequence[NormalEquations], prior: Gaussian, fraction: float) -> "Folds":
        """Factorise what is common to all that is tried.

        Args:
            parts: Normal equations of the searched stretches.
            prior: Of the common coefficients.
            fraction: Effective sample fraction: independent samples over samples.
        """
        numbers, size = folds_of(parts), len(prior.mean)
        whole = total(parts, size)
        folds = [total([parts[k] for k in fold], size) for fold in numbers]
        return cls(
            numbers,
            Marginaliser.of(whole, prior, fraction),
            tuple(Marginaliser.of(fold, prior, fraction) for fold in folds),
            tuple(Marginaliser.of(whole.less(fold), prior, fraction) for fold in folds),
        )

    def columns(self, new: Sequence[NewColumns], wanted: Combinations | None = None) -> "FoldColumns":
        """Return the products of new columns by fold.

        Args:
            new: Their products in each stretch.
            wanted: What is fitted of them; themselves when left out.
        """

        def combined(stretches: Marginaliser, products: NewColumns) -> NewColumns:
            return products if wanted is None else stretches.combined(products, wanted)

        own = [
            combined(fold, added([new[k] for k in numbers]))
            for fold, numbers in zip(self.own, self.numbers, strict=True)
        ]
        return FoldColumns(combined(self.whole, added(new)), tuple(own))

    def marginal(self, columns: "FoldColumns") -> "NewFolds":
        """Return the normal equations of new columns by fold."""
        folds = tuple(
            (own.marginal(inside), rest.marginal(columns.whole.less(inside)))
            for own, rest, inside in zip(self.own, self.rest, columns.own, strict=True)
        )
        return NewFolds(self.whole.marginal(columns.whole), folds)

    def shares(self, columns: "FoldColumns", whole: Total, prior: Gaussian) -> Floats:
        """Return the cost of each fold where one set of coefficients serves all, shape (folds,).

        Args:
            columns: New columns.
            whole: Their normal equations in all stretches; see ``marginal``.
            prior: Of the coefficients of the first of them; the others have none. What the priors cost counts
                for all folds alike.
        """
        count = len(prior.mean)
        first = columns.first(count)
        sizes = prior.posterior(whole.selected(range(count)), 1.0).mean
        common = self.whole.mean - self.whole.factor.solve(self.whole.fraction * first.whole.cross @ sizes)
        prior_cost = (prior.distance(sizes) + self.whole.prior.distance(common)) / len(self.own)
        folds = zip(self.own, first.own, strict=True)
        return np.array([own.squares(inside, common, sizes) + prior_cost for own, inside in folds])

    @cached_property
    def plain_shares(self) -> Floats:
        """Cost of each fold where one set of common coefficients serves all, shape (folds,)."""
        common = self.whole.mean
        prior_cost = self.whole.prior.distance(common) / len(self.own)
        return np.array([own.common_squares(common) + prior_cost for own in self.own])


@dataclass(frozen=True)
class FoldColumns:
    """Products of new columns in all searched stretches, and in each fold."""

    whole: NewColumns
    own: tuple[NewColumns, ...]

    def first(self, count: int) -> "FoldColumns":
        """Return those of the first columns."""
        return FoldColumns(self.whole.first(count), tuple(own.first(count) for own in self.own))


@dataclass(frozen=True)
class NewFolds:
    """Normal equations of new columns, the common coefficients marginalised.

    Args:
        whole: Of all searched stretches.
        folds: Of each fold, and of all others.
    """

    whole: Total
    folds: tuple[Fold, ...]

    def selected(self, columns: Sequence[int]) -> "NewFolds":
        """Return those of some columns, in their order."""
        folds = tuple((own.selected(columns), rest.selected(columns)) for own, rest in self.folds)
        return NewFolds(self.whole.selected(columns), folds)


def folds_of(parts: Sequence[NormalEquations]) -> tuple[tuple[int, ...], ...]:
    """Cut stretches into folds: recordings where there are three or more, else five spans of time."""
    sessions = sorted({part.session for part in parts})
    if len(sessions) >= 3:
        return tuple(
            tuple(k for k, part in enumerate(parts) if part.session == number) for number in sessions
        )
    ordered = sorted(range(len(parts)), key=lambda k: (parts[k].session, parts[k].block))
    cuts = np.array_split(ordered, min(5, len(ordered)))
    return tuple(tuple(int(k) for k in cut) for cut in cuts)
