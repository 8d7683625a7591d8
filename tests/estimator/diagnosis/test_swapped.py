"""Exchanged channels are refused by name, before any model is asked and after."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.swapped import refuse_swapped
from softarm.estimator.errors import InputError
from softarm.estimator.intake.swapped import refuse_swapped_channels
from softarm.estimator.recording import Recording
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.specimen import load_specimen
from tests.estimator.diagnosis.linear_arm import model, session

SOPRA = load_specimen("sopra")


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """Six chambers that follow their set-points, and bends of the segments by their own chambers."""
    rng = np.random.default_rng(0)
    asked = np.repeat(rng.uniform(0.0, 40e3, (12, 6)), 100, axis=0)
    given = asked + rng.normal(0.0, 100.0, asked.shape)
    columns = {f"pressure_cmd_{k}_pa": asked[:, k] for k in range(6)}
    columns |= {f"pressure_{k}_pa": given[:, k] for k in range(6)}
    for section, first in (("intermediate", 0), ("tip", 3)):
        own, other = given[:, first : first + 3], given[:, 3 - first : 6 - first]
        columns[f"bend_{section}_x_rad"] = (own @ [1.0, -0.5, -0.5] + 0.15 * other[:, 0]) * 1e-5
        columns[f"bend_{section}_y_rad"] = (own @ [0.0, 0.8, -0.8] + 0.15 * other[:, 1]) * 1e-5
    return columns


def _check(columns: dict[str, np.ndarray]) -> None:
    time = np.arange(0.0, 12.0, 0.01)
    refuse_swapped_channels(Recording("run", time, columns), SOPRA)


def _exchange(columns: dict[str, np.ndarray], one: str, other: str) -> dict[str, np.ndarray]:
    names = [name for name in columns if name.startswith(one)]
    pairs = {name: name.replace(one, other) for name in names}
    return columns | {a: columns[b] for a, b in pairs.items()} | {b: columns[a] for a, b in pairs.items()}


def test_right_channels_pass(columns: dict[str, np.ndarray]) -> None:
    _check(columns)


def test_pressures_that_follow_each_others_set_points_are_refused(columns: dict[str, np.ndarray]) -> None:
    with pytest.raises(InputError, match="pressure_1_pa and pressure_4_pa look exchanged"):
        _check(_exchange(columns, "pressure_1", "pressure_4"))


def test_pressures_are_told_apart_though_the_set_points_are_correlated(
    columns: dict[str, np.ndarray],
) -> None:
    """A controller that drives two chambers together: either pressure follows either set-point somewhat."""
    both = columns["pressure_cmd_1_pa"] + 0.5 * columns["pressure_cmd_4_pa"]
    together = columns | {"pressure_cmd_4_pa": both, "pressure_4_pa": both}
    _check(together)
    with pytest.raises(InputError, match="pressure_1_pa and pressure_4_pa look exchanged"):
        _check(_exchange(together, "pressure_1", "pressure_4"))


def test_chambers_that_move_alike_are_not_called_exchanged(columns: dict[str, np.ndarray]) -> None:
    alike = {
        name: columns[name[:-4] + "0_pa"] if name.startswith("pressure") else v for name, v in columns.items()
    }
    _check(alike)


def test_exchanged_bends_are_refused_though_one_of_them_is_late(columns: dict[str, np.ndarray]) -> None:
    exchanged = _exchange(columns, "bend_tip", "bend_intermediate")
    late = {name: np.roll(v, 80) if name.startswith("bend_tip") else v for name, v in exchanged.items()}
    with pytest.raises(InputError, match="bend_intermediate and bend_tip look exchanged"):
        _check(late)


@pytest.mark.filterwarnings("error")
def test_set_points_of_which_none_was_read_say_nothing(columns: dict[str, np.ndarray]) -> None:
    lost = {name: np.full_like(v, np.nan) for name, v in columns.items() if name.startswith("pressure_cmd")}
    assert lost
    _check({**columns, **lost})


def test_bends_that_another_segments_chambers_explain_are_refused(columns: dict[str, np.ndarray]) -> None:
    with pytest.raises(InputError, match="bend_intermediate and bend_tip look exchanged"):
        _check(_exchange(columns, "bend_intermediate", "bend_tip"))


@pytest.fixture(scope="module")
def known() -> list[Session]:
    return [session(f"nominal_{k}", k, nominal=True) for k in range(2)]


def _stages(known: list[Session], one: Session) -> list[Stage]:
    fitted = calibrate_sessions(model(), known)
    return [fitted.stage(model(), s) for s in (*known, one)]


def test_against_the_model_exchanged_sensors_are_refused(known: list[Session]) -> None:
    run = session("run", 11)
    refuse_swapped(_stages(known, run))
    exchanged = replace(run, readings=run.readings[:, [2, 3, 0, 1]])
    with pytest.raises(InputError, match="bend_intermediate and bend_tip look exchanged"):
        refuse_swapped(_stages(known, exchanged))


def test_against_the_model_exchanged_chambers_are_refused(known: list[Session]) -> None:
    run = session("run", 11)
    exchanged = replace(run, pressures=run.pressures[:, [0, 1, 2, 5, 4, 3]])
    with pytest.raises(InputError, match="the pressures of chambers 3 and 5 look exchanged"):
        refuse_swapped(_stages(known, exchanged))


def test_a_chamber_without_pressures_is_never_one_whose_columns_to_exchange(known: list[Session]) -> None:
    run = session("run", 11)
    alone = np.zeros_like(run.pressures)
    alone[:, 3] = run.pressures[:, 3]
    response = _stages(known, replace(run, pressures=alone))[-1]
    renamed = replace(
        run, pressures=alone[:, [0, 1, 2, 5, 4, 3]], readings=response.reading_rows - response.residual
    )
    with pytest.raises(InputError, match="chamber 5 were in chamber 3, which is vented; name its columns"):
        refuse_swapped(_stages(known, renamed))


def test_a_few_samples_accuse_no_channel(columns: dict[str, np.ndarray]) -> None:
    exchanged = _exchange(columns, "pressure_1", "pressure_4")
    seen = np.arange(1200) < 40
    _check({name: np.where(seen, values, np.nan) for name, values in exchanged.items()})


def test_against_the_model_sensors_of_one_session_alone_are_left_as_they_are(known: list[Session]) -> None:
    """What the first session calls a sensor another may lack, or be read by something else."""
    run = session("run", 11)
    exchanged = replace(run, readings=run.readings[:, [2, 3, 0, 1]])
    first, second = (_stages(known, one)[-1] for one in (exchanged, run))
    only = second.suite.measurements[0]
    lacking = replace(second, suite=SensorSuite((only,)), session=replace(run, readings=run.readings[:, :2]))
    with pytest.raises(InputError, match="bend_intermediate and bend_tip look exchanged"):
        refuse_swapped([first, lacking])
