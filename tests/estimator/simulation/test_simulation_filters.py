import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softarm.estimator.simulation.filters import first_order, second_order

TIME = np.concatenate([np.linspace(0.0, 1.0, 30), np.linspace(1.3, 3.0, 10)])
VALUES = np.interp(TIME, [0.0, 0.5, 0.6, 3.0], [0.2, 0.2, 1.0, -0.5])


@pytest.mark.parametrize(
    ("inertia", "damping"), [(0.05, 0.01), (0.05, 0.1), (0.02, 0.5), (0.0, 0.3), (0.1, 0.0)]
)
def test_filters_solve_their_equation(inertia: float, damping: float):
    def rate(t: float, y: np.ndarray) -> list[float]:
        u = np.interp(t, TIME, VALUES)
        if inertia == 0.0:
            return [(u - y[0]) / damping, 0.0]
        return [y[1], (u - y[0] - damping * y[1]) / inertia**2]

    exact = solve_ivp(
        rate, (0.0, 3.0), [0.2, 0.0], t_eval=TIME, rtol=1e-8, atol=1e-9, max_step=0.02, method="LSODA"
    )
    out, _ = second_order(TIME, VALUES[:, None], inertia, damping, ())
    assert np.allclose(out[:, 0], exact.y[0], atol=2e-4)


def test_a_filter_without_lag_follows():
    assert np.array_equal(first_order(TIME, VALUES, 0.0, ())[0], VALUES)
    assert np.allclose(first_order(TIME, VALUES, 1e-6, ())[0], VALUES, atol=1e-4)


def test_a_stretch_cut_in_two_gives_the_whole():
    whole, _ = second_order(TIME, VALUES, 0.05, 0.02, ())
    first, memory = second_order(TIME[:17], VALUES[:17], 0.05, 0.02, ())
    second, _ = second_order(TIME[17:], VALUES[17:], 0.05, 0.02, memory)
    assert np.allclose(np.concatenate([first, second]), whole, atol=1e-12)
