import time

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.inverse import InputBounds, QuadraticProgram, solve_program
from softarm.estimator.inverse.unknowns import Unknowns

RANDOM = np.random.default_rng(3)
SIZE = 7


def program(spread: float) -> QuadraticProgram:
    root = RANDOM.normal(size=(SIZE, SIZE))
    lower, upper = -spread * RANDOM.uniform(size=SIZE), spread * RANDOM.uniform(size=SIZE)
    lower[2] = upper[2] = 0.1
    return QuadraticProgram(root @ root.T + 0.1 * np.eye(SIZE), RANDOM.normal(size=SIZE), lower, upper)


@pytest.mark.parametrize("spread", [0.1, 0.5, 50.0])
def test_solution_meets_the_optimality_conditions(spread: float) -> None:
    """At the optimum the gradient vanishes along free inputs and pushes against the bound elsewhere."""
    for _ in range(20):
        given = program(spread)
        solution = solve_program(given)
        assert (given.lower <= solution).all()
        assert (solution <= given.upper).all()
        slope = given.hessian @ solution - given.gradient
        held = given.lower == given.upper
        low = ~held & (solution <= given.lower + 1e-6)
        high = ~held & (solution >= given.upper - 1e-6)
        assert (slope[low] >= -1e-6).all()
        assert (slope[high] <= 1e-6).all()
        np.testing.assert_allclose(slope[~(held | low | high)], 0.0, atol=1e-6)
        assert solution[2] == 0.1


@pytest.mark.parametrize("part", ["hessian", "gradient"])
def test_a_program_that_is_no_number_has_no_solution_and_takes_no_time(part: str) -> None:
    given = program(0.1)
    getattr(given, part)[:] = np.nan
    begin = time.process_time()
    assert np.isnan(solve_program(given)).all()
    assert time.process_time() - begin < 1.0


def test_a_program_that_rounding_keeps_from_the_tolerance_takes_no_time() -> None:
    given = program(0.1)
    large = QuadraticProgram(1e12 * given.hessian, 1e12 * given.gradient, given.lower, given.upper)
    begin = time.process_time()
    np.testing.assert_allclose(solve_program(large), solve_program(given), atol=1e-6)
    assert time.process_time() - begin < 0.02


def test_crossed_bounds_are_refused() -> None:
    with pytest.raises(InputError, match="input 1 has the lower bound 2 above the upper bound 1"):
        InputBounds.free(3).bound(slice(1, 2), 2.0, 1.0)


def test_held_is_not_reported_as_reached() -> None:
    limits = InputBounds.free(3).bound(slice(0, 2), 0.0, 1.0).hold(slice(2, 3), 0.5)
    low, high = limits.reached(np.array([0.0, 1.0, 0.5]), np.ones(3))
    assert low.tolist() == [True, False, False]
    assert high.tolist() == [False, True, False]


def test_names_and_units_of_the_unknowns(arm) -> None:
    unknowns = Unknowns.of(2, arm.loads[:1])
    assert unknowns.names == ("pressure_0", "pressure_1", "intermediate_x")
    assert unknowns.units == ("Pa", "Pa", "N")
