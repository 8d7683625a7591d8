"""The client's own wheel in an environment that holds zenoh and pydantic only."""

import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

from tests.service.network.served import ServedArm

ROOT = Path(__file__).parents[2]
NEEDED = (
    "eclipse-zenoh",
    "pydantic",
    "pydantic-core",
    "annotated-types",
    "typing-extensions",
    "typing-inspection",
)
ROUND_TRIP = """
import sys, softarm_client
with softarm_client.Arm("test", sys.argv[1]) as arm:
    arm.states().wait_for(lambda state: state.mode == "IDLE", 20.0)
    with arm.lease():
        print(arm.arm().mode, next(iter(arm.states())).lease.holder, softarm_client.__file__)
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    folder = tmp_path_factory.mktemp("client")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT / "service" / "softarm_client", check=True, capture_output=True)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    (site,) = (folder / "venv").glob("lib/python*/site-packages")
    for name in NEEDED:
        for top in {Path(str(file)).parts[0] for file in distribution(name).files or []}:
            link = site / top
            if top not in ("..", "__pycache__") and not link.exists():
                link.symlink_to(Path(str(distribution(name).locate_file(top))))
    (wheel,) = folder.glob("softarm_client-*.whl")
    python = folder / "venv" / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--no-index"]
    subprocess.run([*install, str(wheel)], check=True, capture_output=True)
    return python


def test_client_alone_commands_an_arm(python, tmp_path):
    with ServedArm(tmp_path) as served:
        command = [python, "-c", ROUND_TRIP, served.endpoint]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=False, env={"PATH": "/usr/bin:/bin"}
        )
    assert done.returncode == 0, done.stderr
    mode, holder, path = done.stdout.split()
    assert (mode, holder) == ("ARMED", "softarm-client")
    assert path.startswith(str(python.parents[1]))


def test_client_alone_has_the_ros_node(python):
    command = [python, "-m", "softarm_client.ros", "--arm", "test"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={"PATH": "/usr/bin:/bin"})
    assert done.returncode == 2
    assert done.stderr.startswith("softarm: ROS 2: cannot be imported (No module named 'rclpy')")


def test_licence_of_the_client_is_the_project_s():
    assert (ROOT / "service" / "softarm_client" / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
