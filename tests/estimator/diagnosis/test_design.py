"""What a diagnosis regresses on: the effects that may act, the model itself, lines, and what exposes them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis import exact_model
from softarm.estimator.diagnosis.conclude import exposing_variable
from softarm.estimator.diagnosis.diagnose import _no_equilibrium, _require_searched, diagnose
from softarm.estimator.diagnosis.exact_model import SETTLED_WRENCH, ExactModel
from softarm.estimator.diagnosis.library import build_library, library_columns
from softarm.estimator.diagnosis.line import line_errors
from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.pose import observed
from softarm.estimator.diagnosis.result import Cell
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect, met, signals_of
from softarm.estimator.errors import InputError
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import SECTIONS, model, session, suite
from tests.estimator.simulation.straight_arm import world

SENSORS = ("bend_intermediate", "bend_tip")


@pytest.fixture(scope="module")
def stage() -> Stage:
    known = session("nominal", 0, nominal=True)
    return calibrate_sessions(model(), [known]).stage(model(), known)


def test_a_chamber_that_was_never_driven_is_no_suspect() -> None:
    pressures = np.full((10, 6), 20e3)
    pressures[:, 2] = 500.0
    library = build_library(world(SENSORS), pressures, ("chamber_gain",))
    assert [h.place.chamber for h in library.hypotheses] == [None, 0, 1, 3, 4, 5]


def test_what_only_a_drawing_tells_is_calibrated_and_not_looked_for() -> None:
    names = ("chamber_gain", "segment_stiffness", "local_stiffness_defect")
    library = build_library(world(SENSORS), np.full((10, 6), 20e3), names, drawn=True)
    assert {h.name for h in library.hypotheses} == {"chamber_gain", "local_stiffness_defect"}
    assert [h.place.chamber for h in library.hypotheses if h.name == "chamber_gain"] == list(range(6))


def test_an_arm_may_lose_more_of_its_mass_than_a_drawing_may_be_wrong_by() -> None:
    pressures = np.full((10, 6), 20e3)
    least = [
        build_library(world(SENSORS), pressures, ("distributed_mass",), compared=compared)
        .hypotheses[0]
        .effect.parameters[0]
        .lower
        for compared in (True, False)
    ]
    assert least[0] < -0.4 < least[1] < -0.1


def test_an_effect_that_is_there_or_not_has_a_direction_for_each_way_of_being_there() -> None:
    pressures = np.full((10, 6), 20e3)
    library = build_library(world(SENSORS), pressures, ("pressure_saturation",))
    own = [d for d in library.directions if d.hypothesis == 0]
    assert len(own) > 1
    assert {d.parameter for d in own} == {-1}
    assert len({tuple(d.theta) for d in own}) == len(own)


def test_what_a_valve_makes_of_set_points_is_no_hypothesis_where_pressures_were_measured(
    stage: Stage,
) -> None:
    names = ("pressure_saturation", "valve_deadband", "pressure_bias", "line_lag")
    asked, known = (
        {h.name for h in build_library(world(), stage.session.pressures, names, measured=measured).hypotheses}
        for measured in (False, True)
    )
    assert asked == set(names)
    assert known == {"pressure_bias", "line_lag"}  # between the valve's sensor and the arm


def test_an_effect_of_a_sensor_that_a_session_lacks_changes_nothing_there(stage: Stage) -> None:
    library = build_library(world(SENSORS), stage.session.pressures, ("sensor_scale",))
    one = SensorSuite(stage.suite.measurements[:1])
    lacking = replace(
        stage,
        suite=one,
        world=replace(stage.world, sensors=SENSORS[:1]),
        session=replace(stage.session, suite=one, readings=stage.session.readings[:, :2]),
    )
    columns = library_columns(lacking, library)
    moved = {h.place.sensor: bool(np.abs(columns[..., k]).any()) for k, h in enumerate(library.hypotheses)}
    assert moved == {"bend_intermediate": True, "bend_tip": False}


@pytest.mark.parametrize(
    ("name", "theta"), [("tether_stiffness", (0.3, 0.0, 0.4, 0.5)), ("contact_obstacle", (300.0, 0.005, 0.4))]
)
def test_the_model_itself_answers_to_a_load_until_force_and_pose_agree(
    stage: Stage, name: str, theta: tuple[float, ...]
) -> None:
    """A hard wall taken at the depth without it would throw the arm to the other side, and so on."""
    cord = PlacedEffect(EFFECTS[name], Spot(stage.world, Place(section="tip")), np.array(theta))
    exact = ExactModel(stage.exact, stage.drive, stage.arm.baseline, stage.world, stage.arm.baseline)
    drive, response = exact.under([cord])
    seen = signals_of(drive.at(exact.nodes), stage.world, response)
    wanted, _ = cord.effect.act(seen, cord.theta, cord.spot, ())
    pulled = drive.wrenches[exact.nodes]
    assert np.abs(pulled).max() > 1e3 * SETTLED_WRENCH
    np.testing.assert_allclose(pulled, wanted, atol=0.02 * np.abs(wanted).max())


def test_where_no_forces_balance_the_model_answers_nothing(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One answer is not enough for any sample that meets the wall; the others are as they are."""
    monkeypatch.setattr(exact_model, "BALANCES", 2)
    wall = PlacedEffect(
        EFFECTS["contact_obstacle"], Spot(stage.world, Place(section="tip")), np.array([1000.0, 0.03, 0.0])
    )
    exact = ExactModel(stage.exact, stage.drive, stage.arm.baseline, stage.world, stage.arm.baseline)
    plain = signals_of(stage.drive.at(exact.nodes), stage.world, exact.under([])[1])
    touching = met([wall], plain)
    assert 0 < len(touching) < len(exact.nodes)
    _, response = exact.under([wall])
    assert np.flatnonzero(~response.converged).tolist() == touching.tolist()
    assert np.isfinite(exact.between(response.strains)).all()


def test_a_wall_is_met_where_corrected_predictions_have_the_arm(stage: Stage) -> None:
    """The calibrated model is off by 1.5 degrees in two bends, as nominal recordings have shown."""
    strains = np.zeros((stage.session.samples, 2, 4))
    strains[..., 0] = 0.026 * np.sin(stage.session.clock)[:, None]
    truth = stage.arm.respond(stage.drive.strained(strains))
    correction = np.einsum("trs,ts->tr", stage.by_eigenstrain, strains.reshape(len(strains), -1))
    corrected = replace(stage, observed=observed(stage, correction, np.full(stage.suite.size, 1e-3)))
    wall = PlacedEffect(
        EFFECTS["contact_obstacle"], Spot(stage.world, Place(section="tip")), np.array([200.0, 0.02, 1.6])
    )
    expected = replace(stage, arm=replace(stage.arm, baseline=truth)).change([wall])
    off, left = (float(np.abs(own.change([wall]) - expected).max()) for own in (stage, corrected))
    assert off > 0.1 * np.abs(expected).max()
    assert left < 0.15 * off


def test_a_law_of_the_material_sees_the_strains_under_load_alone(stage: Stage) -> None:
    """What nominal recordings correct of a pose bears no load, so a softer wall makes nothing of it."""
    strains = np.full((stage.session.samples, 2, 4), [0.1, 0.0, 0.0, 0.002])
    corrected = stage.moved(strains)
    assert np.abs(corrected.arm.baseline.frames.positions - stage.arm.baseline.frames.positions).max() > 0.01
    np.testing.assert_allclose(corrected.signals.strains, stage.signals.strains, atol=0.05)
    softer = PlacedEffect(
        EFFECTS["segment_stiffness"], Spot(stage.world, Place(segment="lower")), np.array([-0.2])
    )
    difference = corrected.change([softer]) - stage.change([softer])
    assert np.abs(difference).max() < 0.2 * np.abs(stage.change([softer])).max()


def test_a_line_is_learnt_from_sessions_that_have_the_sensor_and_predicts_no_orientation() -> None:
    make = SpecimenSensors(load_specimen("sopra"), SECTIONS, Registration())
    rich = SensorSuite((make.bend("tip"), make.orientation("tip")))
    plain = session("run", 3)
    line = plain.pressures @ np.linspace(1e-6, 6e-6, 6) + 0.1

    def recorded(name: str, own: SensorSuite, size: int) -> Session:
        readings = np.tile(line[:, None], (1, size))
        held = np.arange(plain.samples) % 5 == 0
        return replace(plain, name=name, suite=own, readings=readings, heldout=held)

    errors = line_errors([recorded("rich", rich, 6), recorded("plain", suite(), 4)])
    assert set(errors) == {"bend_tip.x", "bend_tip.y", "bend_intermediate.x", "bend_intermediate.y"}
    assert max(errors.values()) < 1e-9


@pytest.mark.parametrize(
    ("effect", "place", "name", "unit"),
    [
        ("chamber_gain", Place(chamber=2), "pressure of chamber 2", "Pa"),
        ("line_lag", Place(chamber=1), "rate of pressure of chamber 1", "Pa/s"),
        ("hysteresis", Place(), "rate of the pressures' sum", "Pa/s"),
        ("segment_stiffness", Place(segment="lower"), "bend of the last segment", "rad"),
        ("sensor_drift", Place(sensor="bend_tip"), "time", "s"),
    ],
)
def test_an_effect_is_shown_against_what_it_varies_with(
    stage: Stage, effect: str, place: Place, name: str, unit: str
) -> None:
    found, of, values = exposing_variable(stage, effect, place)
    assert (found, of, values.shape) == (name, unit, (stage.session.samples,))
    assert np.ptp(values) > 0.0


@pytest.mark.parametrize(
    ("kind", "name", "place"),
    [
        ("segment", "lower", Place(segment="lower", axis="x")),
        ("chamber", "3", Place(chamber=3)),
        ("sensor", "bend_tip", Place(sensor="bend_tip", axis="x")),
        ("base", "base", Place(section="base", axis="x")),
    ],
)
def test_a_place_on_the_map_is_one_where_effects_act(kind: str, name: str, place: Place) -> None:
    assert Cell(kind, name, "x", "pose", 0.1, "rad", 0.5, 0.01).place == place


@pytest.mark.parametrize(
    ("lost", "problem"), [("prediction", "finds no equilibrium"), ("reading_rows", "no reading is left")]
)
def test_why_nothing_is_left_to_search_is_said(lost: str, problem: str) -> None:
    heldout = np.array([False, False, True])
    rows = {"prediction": np.ones((3, 2)), "reading_rows": np.ones((3, 2))}
    rows[lost][~heldout] = np.nan
    one = SimpleNamespace(
        session=SimpleNamespace(name="run", nominal=False, heldout=heldout),
        reading_rows=rows["reading_rows"],
        residual=rows["reading_rows"] - rows["prediction"],
    )
    with pytest.raises(InputError, match=problem):
        _require_searched([cast("Any", one)], _no_equilibrium([cast("Any", one)]))


def test_recordings_without_a_reading_to_search_are_refused() -> None:
    run = session("run", 4)
    lost = replace(run, readings=np.full_like(run.readings, np.nan))
    with pytest.raises(InputError, match="no reading is left"):
        diagnose(model(), [session("nominal", 0, nominal=True), lost], Inline(), effects=("chamber_gain",))
