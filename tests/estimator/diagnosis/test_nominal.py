"""What nominal recordings show is no change."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.library import Direction, Hypothesis, Library
from softarm.estimator.diagnosis.nominal import MATERIAL, evidence_of_change, passive, prior_before
from softarm.estimator.diagnosis.normal_equations import (
    NormalEquations,
    normal_equations,
)
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import SAMPLES, hypothesis


class ArmOfOneEffect:
    """What nominal priors read of a regression problem: one nuisance and one effect."""

    nuisances, size = 1, 2
    typical = np.ones(2)

    def __init__(self, change: float) -> None:
        self.parts = [
            part
            for number in range(6)
            for part in self._recorded(number, 0.0 if number < 3 else change, nominal=number < 3)
        ]

    def _recorded(self, number: int, change: float, *, nominal: bool) -> list[NormalEquations]:
        rng = np.random.default_rng([9, number])
        columns = rng.normal(size=(SAMPLES, 1, 2))
        truth = np.array([0.4, 0.1 + change])
        residual = columns @ truth + 0.05 * rng.normal(size=(SAMPLES, 1))
        none, blocks = np.zeros(SAMPLES, dtype=bool), np.zeros(SAMPLES, dtype=int)
        scale = np.full(1, 0.05)
        return normal_equations(residual, columns, scale, blocks, none, none, number, nominal=nominal)

    def products(self, weights: object) -> list[NormalEquations]:
        return self.parts

    def prior(self, background: float, form: float) -> Gaussian:
        return Gaussian(np.zeros(2), np.diag([1.0, background**2]))

    def sound(self) -> Gaussian:
        return self.prior(0.3, 1.0)


def change_seen(change: float) -> float:
    arm = cast("Any", ArmOfOneEffect(change))
    prior, width = prior_before(arm, cast("Any", SimpleNamespace(effective_sample_fraction=1.0)), frozenset())
    assert prior.mean == pytest.approx([0.4, 0.1], abs=0.02)
    assert width < MATERIAL
    return evidence_of_change(arm, prior, width, [part for part in arm.parts if not part.nominal], 1.0)


def test_a_change_beyond_what_differs_from_run_to_run_is_evidence():
    assert change_seen(0.0) < 0.0
    assert change_seen(0.02) < 0.0
    assert change_seen(0.5) > 20.0


@dataclass(frozen=True)
class MemoryOfMaterial:
    """What bounds of memory read of a regression problem."""

    library: Library
    nuisances: int = 1
    stages: tuple[Any, ...] = (SimpleNamespace(world=SimpleNamespace(segments=("upper", "lower"))),)

    @property
    def size(self) -> int:
        return self.nuisances + len(self.library.directions)


def test_memory_may_shrink_by_what_nominal_recordings_show_of_it_and_no_further():
    """The upper segment has 0.06 of hysteresis over all reaches, with the whole arm's; the lower one none."""
    upper, whole = (
        Hypothesis(EFFECTS["hysteresis"], Place(segment="upper")),
        Hypothesis(EFFECTS["hysteresis"], Place()),
    )
    heavy = hypothesis("distributed_mass")
    directions = (
        Direction(0, 0, 0, np.array([0.1, 0.03]), 0.1, 0.15),
        Direction(0, 1, 0, np.array([0.1, 0.3]), 0.1, 0.15),
        Direction(1, 0, 0, np.array([0.1, 0.1]), 0.1, 0.15),
        Direction(2, 0, 0, np.array([0.1]), 0.1, 0.1),
    )
    amounts = np.array([0.05, -0.01, 0.02, 0.0]) / [direction.typical for direction in directions]
    prior = Gaussian(np.array([0.7, *amounts]), np.diag([1.0, 0.0, 0.0, (0.01 / 0.15) ** 2, 1.0]))
    bounded = passive(cast("Any", MemoryOfMaterial(Library((upper, whole, heavy), directions))), prior)
    least = [one.effect.parameters[0].lower for one in bounded.library.hypotheses]
    assert least == pytest.approx([-0.06 - 0.02, -0.02 - 0.02, heavy.effect.parameters[0].lower])
    assert bounded.library.hypotheses[0].effect.parameters[1] == EFFECTS["hysteresis"].parameters[1]


def test_halves_of_a_single_nominal_recording_show_what_changes_by_itself():
    def width(change: float) -> float:
        arm = ArmOfOneEffect(change)
        halves = [(number, part) for number, part in enumerate(arm.parts) if number in (1, 4)]
        arm.parts = [replace(part, session=0, block=number, nominal=True) for number, part in halves]
        weights = cast("Any", SimpleNamespace(effective_sample_fraction=1.0))
        return prior_before(cast("Any", arm), weights, frozenset())[1]

    assert width(0.0) < MATERIAL < width(0.5)
