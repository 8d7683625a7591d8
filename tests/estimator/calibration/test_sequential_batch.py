"""A model that solves one sample at a time, made to answer many."""

from dataclasses import replace

import numpy as np
from toy import toy, twists

from softarm.estimator.arm import build_arm
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.sequential_batch import SequentialBatchModel, SolvedSample
from softarm.estimator.specimen import load_specimen

GRAVITY = np.array([0.0, 0.0, 9.81])


def solved(pressures: np.ndarray, **scales: float) -> ArmResponse:
    inputs = BatchInputs(pressures, np.zeros((len(pressures), 0)), GRAVITY)
    return SequentialBatchModel(toy()).with_scales(scales).evaluate(inputs)


def test_a_response_keeps_chosen_samples() -> None:
    whole = solved(np.arange(18.0).reshape(3, 6) * 1e3)
    part = whole.at(np.array([True, False, True]))
    assert len(part.states) == len(part.converged) == 2
    np.testing.assert_array_equal(part.frames.positions, whole.frames.positions[[0, 2]])


def test_pressures_and_stiffness_factors_move_the_sections_as_differences_say() -> None:
    pressures = np.full((1, 6), 3e4) * [1, 0, 0.5, 0, 1, 0]
    at = solved(pressures, upper=1.1)
    here = Frames(at.frames.positions[0], at.frames.rotations[0])
    softer = solved(pressures, upper=1.1 * np.exp(1e-5))
    np.testing.assert_allclose(at.factor_jacobian[0, :, 0], twists(here, softer.frames)[0] / 1e-5, atol=1e-4)
    fuller = solved(pressures + np.eye(6)[2], upper=1.1)
    np.testing.assert_allclose(at.pressure_jacobian[0, :, 2], twists(here, fuller.frames)[0], atol=1e-9)
    assert at.load_jacobian.shape[-1] == 0
    assert not at.gravity_jacobian.any()


def test_a_region_of_another_model_is_left_out() -> None:
    model = SequentialBatchModel(toy())
    assert model.with_scales({"foreign": 2.0}) is model


def test_parts_solved_side_by_side_answer_as_one_after_another(monkeypatch) -> None:
    pressures = np.random.default_rng(3).uniform(0.0, 3e4, (7, 6))
    together = solved(pressures)
    monkeypatch.setattr("softarm.estimator.sequential_batch.PARTS", 1)
    alone = solved(pressures)
    np.testing.assert_array_equal(together.frames.rotations, alone.frames.rotations)
    np.testing.assert_array_equal(together.pressure_jacobian, alone.pressure_jacobian)
    assert together.converged.all()


def test_a_sample_of_finite_elements_begins_where_its_motions_lead(monkeypatch) -> None:
    beam = load_specimen("beam")
    model = build_arm(beam)
    loads = np.full((2, len(model.loads)), 0.05)
    inputs = BatchInputs(np.zeros((2, 0)), loads, GRAVITY)
    first = SequentialBatchModel(model).evaluate(inputs)
    (region, *_) = model.parameters
    softer = SequentialBatchModel(model.with_scales({region: 0.98}))
    counted: list[object] = []
    linearise = FiniteElementModel.linearise
    monkeypatch.setattr(
        FiniteElementModel, "linearise", lambda *given: counted.append(given) or linearise(*given)
    )
    others = replace(inputs, loads=1.02 * loads)
    near = softer.evaluate(others, start=first)
    assert len(counted) == 2  # one each: the prediction is near enough
    anew = softer.evaluate(others)
    np.testing.assert_allclose(near.frames.positions, anew.frames.positions, atol=1e-6)


def test_a_sample_without_a_state_begins_at_the_solved_one_of_most_similar_inputs(monkeypatch) -> None:
    monkeypatch.setattr("softarm.estimator.sequential_batch.PARTS", 1)
    begun: list[tuple[float, float]] = []
    under = SolvedSample.under

    def watched(sample: SolvedSample, model: object, inputs: Inputs) -> object:
        begun.append((sample.inputs.pressures[0], inputs.pressures[0]))
        return under(sample, model, inputs)

    monkeypatch.setattr(SolvedSample, "under", watched)
    solved(np.outer([3e4, 1e4, 2.9e4, 1.1e4], np.eye(6)[0]))
    assert begun == [(0.0, 1e4), (1e4, 1.1e4), (1.1e4, 2.9e4), (2.9e4, 3e4)]
