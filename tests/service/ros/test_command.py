"""The commands where no ROS 2 is installed."""

import subprocess
import sys

import pytest

from softarm.cli import run


@pytest.mark.parametrize("words", [[], ["--ros-args", "-r", "__ns:=/lab", "-p", "ramp_s:=4.0"]])
def test_a_missing_ros_is_one_line_with_its_cure(capsys, monkeypatch, words):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert run(["ros", "--arm", "test", *words]) == 2
    told = capsys.readouterr().err
    assert told.startswith("softarm: ROS 2: cannot be imported (")
    assert "setup.bash" in told
    assert "softarm-client[ros]" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("words", [["--wrong"], ["wrong"]])
def test_arguments_that_do_not_follow_ros_args_are_refused(capsys, words):
    assert run(["ros", "--arm", "test", *words]) == 2
    assert f"{words[0]!r} is unknown" in capsys.readouterr().err


def test_translating_needs_no_library_that_an_installation_of_ros_may_have_in_another_version():
    code = "import sys, softarm_client.ros.bridge, softarm_client.ros.messages; print('numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told == "False\n"
