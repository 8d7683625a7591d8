"""Fits of an effect whose consequence grows faster than its size."""

from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest

from softarm.estimator.diagnosis.fit import (
    MarginalisedProblem,
    Parametrisation,
    RecordingResidual,
    fit_effects,
    fit_laws,
    slopes_of,
    whitened,
)
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.marginal import Marginaliser
from softarm.estimator.diagnosis.normal_equations import NormalEquations, normal_equations, total
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import world

SHAPE = np.sin(np.linspace(0.0, 9.0, 400))[:, None] + np.array([[0.3, -0.2]])
SIZE = -0.3


class Runaway:
    """A stage on which an effect of size x changes the prediction by x / (1 + x), to first order by x."""

    world = world()

    def change(self, effects: Sequence[PlacedEffect], *, exact: bool = False, **_: object) -> np.ndarray:
        size = float(effects[0].theta[0])
        return SHAPE * (size / (1.0 + size) if exact else size)


def problem_of(view: RecordingResidual, parts: Sequence[NormalEquations]) -> MarginalisedProblem:
    """Return the fit of one recording beside one common coefficient."""
    prior = Gaussian(np.zeros(1), np.eye(1))
    return MarginalisedProblem((view,), Marginaliser.of(total(parts, 1), prior, 1.0))


def problem() -> MarginalisedProblem:
    left = SHAPE * SIZE / (1.0 + SIZE) + np.random.default_rng(3).normal(0.0, 1e-3, SHAPE.shape)
    weight, blocks = np.full(SHAPE.shape, 1e3), np.zeros(len(SHAPE), dtype=int)
    common, unseen = np.ones((*SHAPE.shape, 1), dtype=np.float32), np.zeros(len(SHAPE), dtype=bool)
    parts = normal_equations(
        left, common, np.full(SHAPE.shape, 1e-3), blocks, unseen, unseen, 0, nominal=False
    )
    view = RecordingResidual(cast("Stage", Runaway()), left * weight, weight, (common * 1e3).reshape(-1, 1))
    return problem_of(view, parts)


@pytest.mark.parametrize("start", [-0.05, -0.45, 0.2])
def test_a_fit_on_the_model_itself_follows_a_strong_effect(start: float) -> None:
    """The slope at the truth is twice that of the linearisation."""
    effect = Hypothesis(EFFECTS["segment_stiffness"], Place(segment="upper"))
    linear = fit_effects(problem(), (effect,), (np.array([start]),))
    exact = fit_effects(problem(), (effect,), (np.array([start]),), exact=True)
    assert linear.thetas[0][0] == pytest.approx(SIZE / (1.0 + SIZE), abs=1e-3)
    assert exact.thetas[0][0] == pytest.approx(SIZE, abs=1e-3)
    assert exact.gain > 0.99 * linear.gain


def stiffened(depth: np.ndarray, stiffness: float) -> np.ndarray:
    """What a wall changes in an arm of a stiffness of 10 N/m that would go so deep without it."""
    return -depth * stiffness / (stiffness + 10.0)


class Walled:
    """A stage on which a wall of a stiffness holds back the arm."""

    world = world()
    depth = np.maximum(SHAPE, 0.0)

    def change(self, effects: Sequence[PlacedEffect], *, exact: bool = False, **_: object) -> np.ndarray:
        return stiffened(self.depth, float(effects[0].theta[0]))


class Stiffening(Walled):
    """The same, of an arm that stiffens as it is pushed back, which its linearisation does not."""

    def change(self, effects: Sequence[PlacedEffect], *, exact: bool = False, **_: object) -> np.ndarray:
        linear = super().change(effects)
        return linear / (1.0 - 0.1 * linear) if exact else linear


def test_a_wall_is_fitted_on_the_model_itself():
    effect = Hypothesis(EFFECTS["contact_obstacle"], Place(section="tip"))
    truth = PlacedEffect(effect.effect, Spot(world(), effect.place), np.array([250.0, 0.0, 0.0]))
    left = Stiffening().change([truth], exact=True)
    weight = np.full(SHAPE.shape, 1e3)
    blank = np.zeros((SHAPE.size, 1), dtype=np.float32)
    view = RecordingResidual(cast("Stage", Stiffening()), left * weight, weight, blank)
    none = MarginalisedProblem.alone([view])
    linear = fit_effects(none, (effect,), (np.array([60.0, 0.0, 0.0]),))
    exact = fit_effects(none, (effect,), linear.thetas, exact=True)
    assert float(linear.thetas[0][0]) < 150.0
    assert float(exact.thetas[0][0]) == pytest.approx(250.0, rel=0.01)


@pytest.mark.parametrize("stiffness", [40.0, 250.0, 1500.0])
def test_the_stiffness_of_a_hard_wall_lies_within_two_deviations(stiffness: float):
    """It yields by a few hundredths of its depth; a model that errs by as much cannot tell how hard it is."""
    effect = Hypothesis(EFFECTS["contact_obstacle"], Place(section="tip"))
    inside = 0
    for seed in range(20):
        error = 1.0 + 0.03 * np.random.default_rng(seed).normal()
        left = stiffened(Walled.depth, stiffness) * error
        weight = np.full(SHAPE.shape, 1.0 / (0.03 * np.sqrt((Walled.depth**2).sum())))  # one error for all
        blank = np.zeros((SHAPE.size, 1), dtype=np.float32)
        view = RecordingResidual(cast("Stage", Walled()), left * weight, weight, blank)
        none = MarginalisedProblem.alone([view])
        found = fit_effects(none, (effect,), (np.array([60.0, 0.0, 0.0]),))
        inside += abs(float(found.thetas[0][0]) - stiffness) < 2.0 * float(found.stds(0)[0])
    assert inside >= 18


class Creeping:
    """A stage whose prediction creeps, with the stiffness of the model at once or in the end."""

    world = world()
    late = np.roll(SHAPE, 20, axis=0)

    def change(self, effects: Sequence[PlacedEffect], *, exact: bool = False, **_: object) -> np.ndarray:
        strength, _, relaxed = effects[0].theta
        return (SHAPE + strength * self.late) / (1.0 + relaxed * strength) - SHAPE


@pytest.mark.parametrize("relaxed", [0.0, 1.0])
@pytest.mark.parametrize("start", [0.0, 1.0])
def test_no_fit_moves_a_choice_and_each_is_tried(relaxed: float, start: float):
    effect = Hypothesis(EFFECTS["viscoelastic_creep"], Place())
    truth = PlacedEffect(effect.effect, Spot(world(), effect.place), np.array([0.3, 5.0, relaxed]))
    weight = np.full(SHAPE.shape, 1e3)
    blank = np.zeros((SHAPE.size, 1), dtype=np.float32)
    left = Creeping().change([truth]) * weight
    view = RecordingResidual(cast("Stage", Creeping()), left, weight, blank)
    none = MarginalisedProblem.alone([view])
    kept = fit_effects(none, (effect,), (np.array([0.1, 5.0, start]),))
    best = fit_laws(none, (effect,), (np.array([0.1, 5.0, start]),))
    assert kept.thetas[0][2] == start
    assert best.thetas[0][[0, 2]].tolist() == pytest.approx([0.3, relaxed], rel=1e-2)
    assert best.stds(0)[2] == 0.0
    assert best.degrees_of_freedom == 2


def test_slopes_are_of_what_a_fit_moves():
    """A choice between laws is no quantity: a law that is a little another one would be a third."""
    effect = Hypothesis(EFFECTS["viscoelastic_creep"], Place())
    blank = np.zeros((SHAPE.size, 1), dtype=np.float32)
    view = RecordingResidual(cast("Stage", Creeping()), SHAPE, np.ones(SHAPE.shape), blank)
    none = MarginalisedProblem.alone([view])
    parametrisation = Parametrisation.of((effect,))
    values = parametrisation.units(np.array([0.3, 5.0, 0.0]))
    change = whitened(none, (effect,), parametrisation.split(values), exact=False)
    (slopes,) = slopes_of(none, (effect,), parametrisation, values, change)
    assert np.abs(slopes[:, 0]).max() > 0.0
    assert not slopes[:, 2].any()


class Drifting:
    """A stage on which readings follow A (1 - exp(-t / tau)), of which hardly more than A / tau shows."""

    world = world()
    ramp = np.linspace(0.0, 100.0, 400)[:, None] * np.ones((1, 2))

    def change(self, effects: Sequence[PlacedEffect], **_: object) -> np.ndarray:
        size, time_constant = effects[0].theta.tolist()
        return size * (1.0 - np.exp(-self.ramp / time_constant))


def test_where_a_shape_makes_up_for_any_size_its_prior_decides() -> None:
    """Sizes and time constants are drawn from their priors; a wider prior makes three quarters err by 1.8."""
    effect = Hypothesis(EFFECTS["thermal_drift"], Place())
    change, time_constant = effect.effect.parameters
    stage, noise = Drifting(), 0.1
    weight, blocks = np.full(stage.ramp.shape, 1.0 / noise), np.zeros(len(stage.ramp), dtype=int)
    unseen = np.zeros(len(stage.ramp), dtype=bool)
    common = np.zeros((*stage.ramp.shape, 1), dtype=np.float32)
    errors = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        size = abs(rng.normal(0.0, change.spread))
        late = time_constant.typical * np.exp(rng.normal(0.0, time_constant.spread))
        shown = size * (1.0 - np.exp(-stage.ramp / late))
        if shown.max() < 0.5 * noise:
            continue
        left = shown + rng.normal(0.0, noise, stage.ramp.shape)
        parts = normal_equations(left, common, 1.0 / weight, blocks, unseen, unseen, 0, nominal=False)
        view = RecordingResidual(cast("Stage", stage), left * weight, weight, common.reshape(-1, 1))
        own = problem_of(view, parts)
        fit = fit_effects(own, (effect,), (np.array([change.typical, time_constant.typical]),))
        errors.append(abs(np.log(fit.thetas[0][0] / size)))
    assert np.percentile(errors, 75) < np.log(1.5)
