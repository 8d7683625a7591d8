"""What each part of the tracking path buys, and each solver: rows of ``softarm bench step``, in one run."""

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from softarm.common.tables import Cell
from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.linalg.cholesky import CholeskyPlan, FactorPlan
from softarm.estimator.fem.linalg.pardiso import PardisoPlan
from softarm.estimator.fem.linalg.symbolic import analyse
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel
from softarm.estimator.fem.tracking.model import Carrier
from softarm.estimator.fem.tracking.rotation_strain import SingleRotationStrain
from softarm.estimator.inverse import Estimator
from softarm.estimator.model import Inputs

STARTING = 10
"""Instants at the beginning of a motion that are not counted."""

MakeEstimator = Callable[[Any], Estimator[Any, Any]]
Sample = tuple[Inputs, Floats, Floats]


@dataclass(frozen=True)
class StraightSteps:
    """Carries steps along, but moves straight along them."""

    carrier: Carrier

    def __getattr__(self, name: str) -> Any:
        return getattr(self.carrier, name)

    def moved(self, displacement: Floats, deformation: Any, step: Floats, rotations: Any) -> Floats:
        """Move by a linear step, carried along the rotations."""
        del deformation
        divergence = self.carrier.carried_divergence(rotations, step)
        return displacement + self.carrier.solve_poisson(divergence)


class NothingCarried:
    """Takes the old factor's steps as they are."""

    def deformation(self, displacement: Floats) -> Floats:
        """Return the displacement: no gradient is wanted."""
        return displacement

    def rotations(self, before: Floats, after: Floats) -> None:
        """Return nothing: nothing is rotated."""

    def solve_poisson(self, nodal: Floats) -> Floats:
        """Return the values: no step is put together from gradients."""
        return nodal

    def carried_divergence(self, rotations: None, nodal: Floats) -> Floats:  # noqa: ARG002
        """Return the step as it is."""
        return nodal

    def pulled_back(self, rotations: None, forces: Floats) -> Floats:  # noqa: ARG002
        """Return the forces as they are."""
        return forces

    def moved(
        self,
        displacement: Floats,
        deformation: Floats,  # noqa: ARG002
        step: Floats,
        rotations: None,  # noqa: ARG002
    ) -> Floats:
        """Move straight along a step."""
        return displacement + step


def tracking_parts(
    model: FiniteElementModel, samples: Sequence[Sample], make: MakeEstimator, rate_hz: float
) -> list[dict[str, Cell]]:
    """Follow a motion with all parts of the tracking path, and with each of them switched off.

    All estimators see the same instant in turn, and each background thread is waited for before the next, so
    that what disturbs the machine disturbs all alike and the ratios repeat.

    Args:
        model: The finite-element model.
        samples: True inputs, noisy readings and noisy pressures at each instant.
        make: Makes the estimator of a model.
        rate_hz: Instants per second.
    """
    fast = SingleRotationStrain.of(model.body)
    cases: dict[str, tuple[Carrier | None, bool, bool]] = {
        "nothing": (fast, True, True),
        "background factorisation": (fast, True, False),
        "carrying the factor along with the material": (NothingCarried(), True, True),
        "finite rotations of steps": (StraightSteps(fast), True, True),
        "single-precision factor": (fast, False, True),
        "compiled single-precision rotation-strain": (model.body.rotation_strain, True, True),
        "reuse of a factor": (None, True, False),
    }
    spent: dict[str, list[float]] = {name: [] for name in cases}
    iterations: dict[str, list[int]] = {name: [] for name in cases}
    converged = dict.fromkeys(cases, 0)
    with ExitStack() as stack:
        threads, estimators = {}, {}
        for name, (carrier, single, background) in cases.items():
            thread = None
            if background:
                thread = stack.enter_context(BackgroundFactorisation(model, single=single))
            threads[name] = thread
            tracked = TrackingModel(model, thread, carrier=carrier, single=single) if carrier else model
            estimators[name] = make(tracked)
        names = list(cases)
        for k, (inputs, readings, pressures) in enumerate(samples):
            for name in names[k % len(names) :] + names[: k % len(names)]:
                begin = time.thread_time()
                estimate = estimators[name].update(k / rate_hz, readings, pressures, inputs.gravity)
                spent[name].append(1e3 * (time.thread_time() - begin))
                iterations[name].append(estimate.iterations)
                converged[name] += estimate.converged
                thread = threads[name]
                if thread is not None:
                    thread.wait()
    return [_row(name, spent, iterations[name], converged[name]) for name in names]


def _row(name: str, spent: dict[str, list[float]], iterations: list[int], converged: int) -> dict[str, Cell]:
    part, whole = np.array(spent[name][STARTING:]), np.array(spent["nothing"][STARTING:])
    p99 = float(np.percentile(part, 99))
    return {
        "without": name,
        "median_ms": float(np.median(part)),
        "p99_ms": p99,
        "median_ratio": float(np.median(part / whole)),
        "p99_ratio": p99 / float(np.percentile(whole, 99)),
        "linearisations": float(np.mean(iterations[STARTING:])),
        "converged_percent": 100.0 * converged / len(iterations),
    }


def solvers(
    model: FiniteElementModel, displacement: Floats, inputs: Inputs, repeats: int
) -> list[dict[str, Cell]]:
    """Time the factor of a tangent and its solution for all inputs by each solver, in turn.

    The last column is the sum of both medians over that of the multifrontal factor.
    """
    tangent = model.balance(displacement, inputs).evaluation.tangent
    assert tangent is not None
    pattern, body = model.body.pattern, model.body
    matrix = pattern.matrix(tangent.values, tangent.mirror)
    forces = model.linearise(FiniteElementState(displacement, inputs), inputs).input_forces()
    plans = {"multifrontal": FactorPlan(pattern, CholeskyPlan.of(analyse(pattern, body.ordering)))}
    if (pardiso := PardisoPlan.of(pattern)) is not None:
        plans["PARDISO"] = FactorPlan(pattern, pardiso)
    work: dict[str, Callable[[], tuple[float, float]]] = {
        name: lambda plan=plan: _timed(lambda: plan.factorise(tangent), lambda f: f.solve(forces))  # type: ignore[misc]
        for name, plan in plans.items()
    }
    work["SuperLU"] = lambda: _timed(lambda: splu(matrix), lambda f: f.solve(forces.T))
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in work}
    for repeat in range(repeats + 1):
        for name, measure in work.items():
            if name != "SuperLU" or repeat <= repeats // 8 + 1:
                spent[name].append(measure())
    reference = np.median(np.array(spent["multifrontal"][1:]), axis=0).sum()
    return [_solver_row(name, np.array(times[1:]), float(reference)) for name, times in spent.items()]


def _timed(factorise: Callable[[], Any], solve: Callable[[Any], Any]) -> tuple[float, float]:
    """Time a factor and its solution by the processor time of this thread [ms]."""
    begin = time.thread_time()
    factor = factorise()
    middle = time.thread_time()
    solve(factor)
    return 1e3 * (middle - begin), 1e3 * (time.thread_time() - middle)


def _solver_row(name: str, times: Floats, reference: float) -> dict[str, Cell]:
    factor, solution = np.median(times, axis=0).tolist()
    return {
        "solver": name,
        "factor_ms": factor,
        "factor_p99_ms": float(np.percentile(times[:, 0], 99)),
        "solution_ms": solution,
        "ratio": (factor + solution) / reference,
    }
