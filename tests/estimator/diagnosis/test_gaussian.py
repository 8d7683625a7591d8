import numpy as np
import pytest

from softarm.estimator.diagnosis.gaussian import Factor, Gaussian
from softarm.estimator.diagnosis.marginal import Marginal, Marginaliser, cost_of
from softarm.estimator.diagnosis.normal_equations import Total, normal_equations, renewed, total, with_columns


@pytest.fixture
def data() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(40, 2, 5))
    residual = columns @ np.array([0.5, -1.0, 0.0, 0.2, 0.0]) + 0.1 * rng.normal(size=(40, 2))
    residual[3, 1] = np.nan
    return residual, columns


BLOCKS = np.arange(40) // 10


def _products(residual: np.ndarray, columns: np.ndarray) -> list:
    scale = np.array([0.1, 0.2])
    return normal_equations(
        residual, columns, scale, BLOCKS, np.zeros(40, dtype=bool), np.zeros(40, dtype=bool), 0, nominal=False
    )


def test_a_belief_learns_what_least_squares_finds(data: tuple[np.ndarray, np.ndarray]) -> None:
    residual, columns = data
    prior = Gaussian(np.zeros(5), 1e8 * np.eye(5))
    found = prior.posterior(total(_products(residual, columns), 5), 1.0)
    seen = np.isfinite(residual)
    weight = np.broadcast_to([10.0, 5.0], seen.shape)[seen]
    rows = columns[seen] * weight[:, None]
    expected = np.linalg.lstsq(rows, residual[seen] * weight, rcond=None)[0]
    assert found.mean == pytest.approx(expected, rel=1e-5, abs=1e-7)
    assert found.covariance == pytest.approx(np.linalg.inv(rows.T @ rows), rel=1e-4)


def test_more_coefficients_leave_the_precision_of_the_others() -> None:
    known = Gaussian(np.zeros(2), np.array([[2.0, 0.3], [0.3, 1.0]]))
    grown = known.augment(1.0, 0.25, 2)
    assert grown.precision == pytest.approx(np.linalg.inv(grown.covariance), abs=1e-8)


def test_a_sum_less_a_stretch_is_that_of_the_others(data: tuple[np.ndarray, np.ndarray]) -> None:
    first, *others = _products(*data)
    rest, expected = total([first, *others], 5).less(total([first], 5)), total(others, 5)
    assert rest.count == expected.count
    assert rest.sum_of_squares == pytest.approx(expected.sum_of_squares)
    assert rest.matrix == pytest.approx(expected.matrix)
    assert rest.vector == pytest.approx(expected.vector)


def test_the_gain_of_extra_coefficients_is_the_fall_of_the_cost(data: tuple[np.ndarray, np.ndarray]) -> None:
    residual, columns = data
    known = Gaussian(np.zeros(4), 0.01 * np.eye(4))
    with_extra = Gaussian(np.zeros(5), np.diag([0.01] * 4 + [1e6]))
    parts = _products(residual, np.concatenate([columns[..., :4], columns[..., 1:2]], axis=-1))
    small = [type(p)(**{**vars(p), "matrix": p.matrix[:4, :4], "vector": p.vector[:4]}) for p in parts]
    marginal = Marginal.of(Marginaliser.of(total(small, 4), known, 1.0))
    gain, _ = marginal.gain([1])
    after = cost_of(with_extra, total(parts, 5), 1.0)
    assert gain == pytest.approx(marginal.cost - after, rel=1e-3)


def test_the_usual_gain_is_the_fall_of_the_cost_from_coefficients_held_at_their_mean(
    data: tuple[np.ndarray, np.ndarray],
) -> None:
    parts = total(_products(*data), 5)
    marginal = Marginal.of(Marginaliser.of(parts, Gaussian(np.zeros(5), 0.01 * np.eye(5)), 1.0))
    held = Gaussian(np.zeros(5), np.diag([0.01, 1e-10, 0.01, 1e-10, 0.01]))
    fall = cost_of(held, parts, 1.0) - marginal.cost
    assert marginal.usual_gain([1, 3]) == pytest.approx(fall, rel=1e-3)


def test_products_of_another_residual_and_of_more_columns(data: tuple[np.ndarray, np.ndarray]) -> None:
    residual, columns = data
    scale = np.array([0.1, 0.2])
    first = _products(residual, columns)
    other = np.where(np.isfinite(residual), residual - 0.3, np.nan)
    for a, b in zip(renewed(first, other, columns, scale, BLOCKS), _products(other, columns), strict=True):
        assert a.vector == pytest.approx(b.vector)
        assert a.sum_of_squares == pytest.approx(b.sum_of_squares)
    new = with_columns(first, residual, columns, columns[..., 2:4] ** 2, scale, BLOCKS)
    direct = _products(residual, np.concatenate([columns, columns[..., 2:4] ** 2], axis=-1))
    for own, b in zip(new, direct, strict=True):
        assert own.cross == pytest.approx(b.matrix[:5, 5:])
        assert own.matrix == pytest.approx(b.matrix[5:, 5:])
        assert own.vector == pytest.approx(b.vector[5:])


def test_a_factor_solves_badly_scaled_matrices() -> None:
    size = np.array([1e-4, 1.0, 1e4])
    matrix = np.outer(size, size) * (np.eye(3) + 0.2)
    right = matrix @ np.array([1.0, 2.0, 3.0])
    assert Factor.of(matrix).solve(right) == pytest.approx([1.0, 2.0, 3.0], rel=1e-5)


def test_rounding_that_makes_a_matrix_indefinite_makes_no_belief_so() -> None:
    """Products in single precision may; what is solved for then has to cost something nevertheless."""
    matrix = np.array([[1.0, 1.1], [1.1, 1.0]])
    assert np.linalg.eigvalsh(matrix)[0] < 0.0
    factor = Factor.of(matrix)
    for right in np.eye(2), np.array([[1.0, -1.0], [1.0, 1.0]]):
        assert (np.diag(right.T @ factor.solve(right)) > 0.0).all()


def test_a_column_of_which_rounding_leaves_less_than_nothing_stays_finite() -> None:
    """Others stand for it, so that single precision decides the sign of what is left."""
    matrix = np.array([[-5.0, 2.0], [2.0, 1e4]])
    solved = Factor.of(matrix).solve(np.array([1e-3, 2.0]))
    assert np.abs(solved).max() < 1.0
    prior = Gaussian(np.zeros(2), np.diag([1e6, 1.0]))
    learnt = prior.posterior(Total(9.0, matrix, np.array([1e-3, 2.0]), 1.0), 1.0)
    assert np.isfinite(cost_of(learnt, Total(9.0, matrix, np.array([1e-3, 2.0]), 1.0), 1.0))
