"""The commands for a running arm, over a real session to a real controller."""

import json
import threading

import pytest

from softarm.cli import run
from softarm.cli.status import status_tables
from softarm_client import Arm, Estimate
from softarm_client.messages import LoadEstimate, SectionPose
from tests.service.network.served import ServedArm


@pytest.fixture
def served(tmp_path):
    with ServedArm(tmp_path) as served:
        with Arm("test", served.endpoint) as arm:
            arm.states().wait_for(lambda state: state.mode == "IDLE", 20.0)
        yield served


@pytest.fixture
def softarm(served, capsys):
    """Run a command on the arm and return its exit status and its tables."""

    def call(*words):
        capsys.readouterr()
        status = run([*words, "--arm", "test", "--endpoint", served.endpoint, "--json"])
        captured = capsys.readouterr()
        return status, json.loads(captured.out) if captured.out else captured.err

    return call


def test_status_shows_mode_and_pressures(softarm):
    status, shown = softarm("status")
    assert status == 0
    arm, _, chambers, _ = shown["tables"]
    assert arm["rows"][0]["mode"] == "IDLE"
    assert [row["setpoint_kpa"] for row in chambers["rows"]] == [0.0] * 6


def test_an_estimator_that_is_being_built_is_not_called_missing(served):
    with Arm("test", served.endpoint) as arm:
        state = arm.state()
    starting = status_tables("test", state.model_copy(update={"mode": "STARTING"}), None)
    assert "is being built" in starting[0].notes[0]
    assert "see the findings" in status_tables("test", state, None)[0].notes[0]


def test_a_name_that_no_arm_can_have_is_wrong_use(capsys):
    assert run(["status", "--arm", "my arm"]) == 2
    assert capsys.readouterr().err == (
        "softarm: arm: 'my arm' cannot be the name of an arm; use letters, digits, - and _\n"
    )


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["record", "--name", "a/b"], "'a/b': use 1 to 60 letters"),
        (["teach", "save", "a/b"], "'a/b': use 1 to 60 letters"),
        (["record", "--start", "--stop"], "give only one of --seconds, --start and --stop."),
        (["status", "--endpoint", "nowhere"], "(Endpoints must be of the form <protocol>/<address>"),
    ],
)
def test_wrong_use_is_refused_before_an_arm_is_asked(words, why, capsys):
    assert run([*words, "--arm", "nobody"]) == 2
    said = capsys.readouterr().err
    assert why in said
    assert said.count("\n") == 1
    assert "Err(" not in said


def test_a_file_that_is_no_zenoh_configuration_is_named_with_its_fault(tmp_path, capsys):
    path = tmp_path / "users.toml"
    path.write_text("a = [1\n")
    assert run(["status", "--arm", "nobody", "--zenoh", str(path)]) == 2
    assert "is not a zenoh configuration (unclosed array, expected `]`)" in capsys.readouterr().err


def test_positions_are_rounded_to_micrometres(served):
    with Arm("test", served.endpoint) as arm:
        state = arm.state()
    base = SectionPose(section="base", position_m=(1.4e-18, 0.0, 0.14), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0))
    _, sections, *_ = status_tables("test", state.model_copy(update={"sections": (base,)}), None)
    assert [sections.rows[0][f"{axis}_mm"] for axis in "xyz"] == [0.0, 0.0, 140.0]


def test_stop_latches_and_clear_leaves_the_fault(softarm, served):
    assert softarm("stop") == (0, {"title": "Arm test", "rows": [{"mode": "FAULTED"}], "notes": []})
    assert served.mode == "FAULTED"
    status, shown = softarm("clear")
    assert (status, shown["rows"][0]["mode"]) == (0, "IDLE")


def test_arm_holds_pressures_and_vents(softarm, served):
    held = []
    command = served.valves.command

    def note(setpoint, lifetime_s):
        held.append(tuple(setpoint))
        command(setpoint, lifetime_s)

    served.valves.command = note
    status, shown = softarm("arm", "--kpa", "20,0,0,0,0,0", "--seconds", "0.5")
    assert (status, shown["rows"][0]["mode"]) == (0, "IDLE")
    assert max(pressures[0] for pressures in held) > 0.0
    assert served.valves.pressures == (0.0,) * 6


def test_arm_ends_with_status_1_when_somebody_stops_it(softarm, served):
    def stop():
        with Arm("test", served.endpoint) as other:
            other.states().wait_for(lambda state: state.mode == "ARMED", 20.0)
            other.stop()

    stopping = threading.Thread(target=stop)
    stopping.start()
    status, told = softarm("arm")
    stopping.join()
    assert status == 1
    assert "left ARMED for FAULTED" in told


@pytest.mark.parametrize(
    ("words", "status", "named"),
    [
        (("arm", "--kpa", "20;0"), 2, "--kpa"),
        (("arm", "--kpa", "20,0"), 1, "6 pressures"),
        (("teach", "goto", "nowhere"), 1, "nowhere"),
    ],
)
def test_a_refusal_is_one_line_with_its_status(softarm, served, words, status, named):
    found, told = softarm(*words)
    assert (found, named in told, told.count("\n")) == (status, True, told.count("armed;") + 1)
    assert served.mode == "IDLE"


def test_tare_lists_what_now_counts_as_zero(softarm):
    status, shown = softarm("tare")
    zeros = {(row["section"], row["axis"]): row["now_zero_n"] for row in shown["rows"]}
    forces = {("intermediate", "x"): 0.0, ("intermediate", "y"): 0.0, ("tip", "x"): 0.4, ("tip", "y"): 0.1}
    assert (status, zeros) == (0, forces)


def test_no_poses_are_listed_as_none(softarm):
    assert softarm("teach", "list") == (0, {"title": "Poses of test", "rows": [], "notes": []})


def test_an_arm_that_does_not_answer_is_status_1(served, capsys):
    assert run(["status", "--arm", "absent", "--endpoint", served.endpoint]) == 1
    assert "absent/state: nothing published for 2 s" in capsys.readouterr().err


def test_forces_have_deviations_only_where_they_are_estimated(served):
    known, none = 4e-4, None
    covariance = ((known, 0.0, none), (0.0, known, none), (none, none, none))
    load = LoadEstimate(section="tip", force_n=(0.3, 0.0, 0.0), covariance_n2=covariance)
    pose = SectionPose(section="tip", position_m=(0.0, 0.0, 0.27), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0))
    with Arm("test", served.endpoint) as arm:
        state = arm.state().model_copy(update={"sections": (pose,)})
    estimate = Estimate.model_construct(status="converged", latency_s=0.01, loads=(load,))
    _, sections, _, _ = status_tables("sopra", state, estimate)
    row = sections.rows[0]
    assert (row["z_mm"], row["force_x_n"], row["std_x_n"]) == (270.0, 0.3, 0.02)
    assert (row["force_z_n"], row["std_z_n"]) == (None, None)
