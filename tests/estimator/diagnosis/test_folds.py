"""What is known of new columns once the common coefficients are marginalised, against all of them at once."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.folds import Folds
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.marginal import Combinations, Marginaliser, cost_of
from softarm.estimator.diagnosis.nominal import BACKGROUND, background_of, predictive
from softarm.estimator.diagnosis.normal_equations import (
    NewColumns,
    NormalEquations,
    Total,
    added,
    normal_equations,
    total,
)

COMMON, NEW, FRACTION = 4, 2, 0.3


@pytest.fixture
def prior() -> Gaussian:
    root = np.random.default_rng(5).normal(size=(COMMON, COMMON))
    return Gaussian(np.array([0.1, -0.2, 0.3, 0.0]), 0.05 * (root @ root.T + np.eye(COMMON)))


@pytest.fixture
def parts() -> list[NormalEquations]:
    """Recordings with common columns and then new ones."""
    found = []
    for number in range(4):
        rng = np.random.default_rng([6, number])
        columns = rng.normal(size=(30, 2, COMMON + NEW))
        residual = 0.4 * columns[..., -1] + rng.normal(size=(30, 2))
        none, blocks = np.zeros(30, dtype=bool), np.arange(30) // 15
        found += normal_equations(residual, columns, np.ones(2), blocks, none, none, number, nominal=False)
    return found


def known(parts: list[NormalEquations]) -> list[NormalEquations]:
    return [
        replace(part, matrix=part.matrix[:COMMON, :COMMON], vector=part.vector[:COMMON]) for part in parts
    ]


def new_of(parts: list[NormalEquations]) -> list[NewColumns]:
    return [
        NewColumns(part.matrix[:COMMON, COMMON:], part.matrix[COMMON:, COMMON:], part.vector[COMMON:])
        for part in parts
    ]


def joint(prior: Gaussian, extra: Gaussian) -> Gaussian:
    """Put independent coefficients behind the common ones."""
    grown = prior.augment(0.0, 1.0, len(extra.mean))
    covariance = grown.covariance.copy()
    covariance[COMMON:, COMMON:] = extra.covariance
    return Gaussian(np.concatenate([prior.mean, extra.mean]), covariance)


def marginal_of(parts: list[NormalEquations], prior: Gaussian) -> Total:
    seen = Marginaliser.of(total(known(parts), COMMON), prior, FRACTION)
    return seen.marginal(added(new_of(parts)))


def test_new_columns_are_learnt_as_beside_the_common_ones(prior, parts):
    extra = Gaussian(np.array([0.2, 0.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))
    everything = total(parts, COMMON + NEW)
    expected = joint(prior, extra).posterior(everything, FRACTION)
    found = extra.posterior(marginal_of(parts, prior), 1.0)
    assert found.mean == pytest.approx(expected.mean[COMMON:], rel=1e-6)
    assert found.covariance == pytest.approx(expected.covariance[COMMON:, COMMON:], rel=1e-6)
    cost = cost_of(extra, marginal_of(parts, prior), 1.0)
    assert cost == pytest.approx(cost_of(joint(prior, extra), everything, FRACTION), rel=1e-7)


def test_densities_differ_as_those_of_all_coefficients(prior, parts):
    """What the common coefficients add is the same for all new columns."""
    small, large = (Gaussian(np.zeros(NEW), size * np.eye(NEW)) for size in (0.01, 1.0))
    everything, found = total(parts, COMMON + NEW), marginal_of(parts, prior)
    expected = predictive(joint(prior, large), everything, FRACTION) - predictive(
        joint(prior, small), everything, FRACTION
    )
    assert predictive(large, found, 1.0) - predictive(small, found, 1.0) == pytest.approx(expected, rel=1e-6)


def test_without_new_columns_the_cost_is_that_of_the_common_ones(prior, parts):
    seen = Marginaliser.of(total(known(parts), COMMON), prior, FRACTION)
    expected = prior.posterior(seen.data, FRACTION)
    assert seen.mean == pytest.approx(expected.mean)
    assert seen.cost == pytest.approx(cost_of(prior, seen.data, FRACTION))
    assert seen.marginal(added(new_of(parts))).selected([]).sum_of_squares == seen.cost
    assert cost_of(NOTHING, Total(1.0, np.zeros((0, 0)), np.zeros(0), 2.0), 1.0) == 2.0


def test_combinations_are_columns_of_their_own(prior, parts):
    wanted = Combinations(np.array([[1.0], [-2.0]]), np.array([[0.5], [0.0], [3.0], [1.0]]))
    seen = Marginaliser.of(total(known(parts), COMMON), prior, FRACTION)
    found = seen.combined(added(new_of(parts)), wanted)
    weights = np.concatenate([wanted.common, wanted.new])[:, 0]
    everything = total(parts, COMMON + NEW)
    assert found.cross[:, 0] == pytest.approx((everything.matrix @ weights)[:COMMON])
    assert found.matrix[0, 0] == pytest.approx(weights @ everything.matrix @ weights)
    assert found.vector[0] == pytest.approx(weights @ everything.vector)


def test_folds_are_recordings_and_all_others(prior, parts):
    folds = Folds.of(known(parts), prior, FRACTION)
    assert folds.numbers == ((0, 1), (2, 3), (4, 5), (6, 7))
    shown = folds.marginal(folds.columns(new_of(parts)))
    for number, (own, others) in enumerate(shown.folds):
        inside = [part for part in parts if part.session == number]
        outside = [part for part in parts if part.session != number]
        for found, expected in ((own, inside), (others, outside)):
            assert found.matrix == pytest.approx(marginal_of(expected, prior).matrix)
            assert found.vector == pytest.approx(marginal_of(expected, prior).vector)
            assert found.sum_of_squares == pytest.approx(marginal_of(expected, prior).sum_of_squares)


def test_another_residual_leaves_what_was_factorised(prior, parts):
    other = [
        replace(part, vector=2.0 * part.vector, sum_of_squares=4.0 * part.sum_of_squares) for part in parts
    ]
    whole = total(known(parts), COMMON)
    renewed = Marginaliser.of(whole, prior, FRACTION).renewed(known(other))
    expected = Marginaliser.of(total(known(other), COMMON), prior, FRACTION)
    found, direct = (one.marginal(added(new_of(other))) for one in (renewed, expected))
    assert found.vector == pytest.approx(direct.vector)
    assert found.sum_of_squares == pytest.approx(direct.sum_of_squares)


def test_what_nominal_recordings_have_of_a_column_is_no_change(prior, parts):
    """Marginalised, it predicts the recordings in question as all coefficients do that these teach."""
    parts = [replace(part, matrix=part.matrix[:-1, :-1], vector=part.vector[:-1] + 3.0) for part in parts]
    nominal, questioned = parts[:4], parts[4:]
    width, size, spreads = 0.1, 0.5, np.full(COMMON, 0.02)
    learnt = prior.augment(0.0, (BACKGROUND / size) ** 2).posterior(total(nominal, COMMON + 1), FRACTION)
    everything = learnt.inflate(np.append(spreads, width / size))
    expected = cost_of(everything, total(questioned, COMMON + 1), FRACTION)
    usual = Marginaliser.of(total(known(nominal), COMMON), prior, FRACTION)
    less, background = background_of(usual, added(new_of(nominal)), width, size)
    before = prior.posterior(usual.data, FRACTION).inflate(spreads)
    seen = Marginaliser.of(total(known(questioned), COMMON), before, FRACTION)
    wanted = Combinations(np.ones((1, 2)), np.concatenate([-less, np.zeros_like(less)], axis=1))
    found = seen.marginal(seen.combined(added(new_of(questioned)), wanted))
    assert cost_of(background, found, 1.0) == pytest.approx(expected, rel=1e-7)


def test_shares_of_the_folds_add_up_to_the_cost_of_one_set_of_coefficients(prior, parts):
    folds = Folds.of(known(parts), prior, FRACTION)
    extra = Gaussian(np.array([0.2, 0.0]), np.array([[0.5, 0.1], [0.1, 0.3]]))
    everything, columns = total(parts, COMMON + NEW), folds.columns(new_of(parts))
    for known_sizes in (NOTHING, extra):
        both = joint(prior, known_sizes)
        seen = everything.selected(range(len(both.mean)))
        shares = folds.shares(columns, folds.marginal(columns).whole, known_sizes)
        assert len(shares) == len(folds.numbers)
        assert shares.sum() == pytest.approx(cost_of(both, seen, FRACTION), rel=1e-6)


def test_a_fold_that_a_size_does_not_fit_has_less_of_the_gain():
    sizes, found = [2.0, 2.0, 2.0, 2.0, -1.0], []
    for number, size in enumerate(sizes):
        rng = np.random.default_rng([5, number])
        columns = rng.normal(size=(60, 1, 2))
        residual = size * columns[..., 1] + rng.normal(size=(60, 1))
        none, blocks = np.zeros(60, dtype=bool), np.zeros(60, dtype=int)
        found += normal_equations(residual, columns, np.ones(1), blocks, none, none, number, nominal=False)
    common = [replace(part, matrix=part.matrix[:1, :1], vector=part.vector[:1]) for part in found]
    new = [NewColumns(part.matrix[:1, 1:], part.matrix[1:, 1:], part.vector[1:]) for part in found]
    folds = Folds.of(common, Gaussian(np.zeros(1), 1e-2 * np.eye(1)), 1.0)
    columns_ = folds.columns(new)
    whole, any_size = folds.marginal(columns_).whole, Gaussian(np.zeros(1), 100.0 * np.eye(1))
    gains = folds.shares(columns_, whole, NOTHING) - folds.shares(columns_, whole, any_size)
    assert gains[:4].min() > 0.0 > gains[4]


def test_new_columns_behind_the_others_are_columns_like_these(parts):
    for whole, part, new in zip(parts, known(parts), new_of(parts), strict=True):
        bordered = part.bordered(new.first(1))
        wider = slice(COMMON + 1)
        assert bordered.matrix == pytest.approx(whole.matrix[wider, wider])
        assert bordered.vector == pytest.approx(whole.vector[wider])
        other = new.beside_first(1)
        assert other.cross == pytest.approx(whole.matrix[wider, COMMON + 1 :])
        assert other.matrix == pytest.approx(whole.matrix[COMMON + 1 :, COMMON + 1 :])
        assert other.vector == pytest.approx(whole.vector[COMMON + 1 :])
