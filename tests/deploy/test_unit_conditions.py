"""Each unit's command under the unit's own conditions, for two arms on one host."""

import os
import re
import shutil
import subprocess
import sysconfig
import urllib.request
from pathlib import Path

import pytest

from softarm_client import Arm
from softarm_client.errors import UnreachableError
from tests.deploy.test_units import install
from tests.deploy.test_zenoh import as_user, with_users
from tests.deploy.unit_conditions import UID, InstalledUnit, SupervisorSocket, refusal
from tests.service.page.test_server import free_port

ARMS = ("left", "right-arm")
REASON = refusal()
pytestmark = [
    pytest.mark.skipif(bool(REASON), reason=f"no mount namespace: {REASON}"),
    pytest.mark.timeout(900),
]


@pytest.fixture
def host(environment, tmp_path):
    """Both arms installed below a root of their own, on ports that are free here."""
    for arm in ARMS:
        install(tmp_path, arm, SOFTARM_PREFIX=str(environment.parent))
        path = tmp_path / f"etc/softarm/{arm}.toml"
        text = re.sub(r"127\.0\.0\.1:\d+", f"127.0.0.1:{free_port()}", path.read_text())
        path.write_text(re.sub(r"^port = \d+", f"port = {free_port()}", text, flags=re.M))
    tmp_path.chmod(0o755)
    return tmp_path


@pytest.fixture
def trees(environment):
    """What is installed: the prefix, and the packages to which it links."""
    return environment.parent, Path(sysconfig.get_paths()["purelib"])


@pytest.fixture
def supervisor():
    sockets = []

    def make(name):
        sockets.append(SupervisorSocket(name))
        return sockets[-1]

    yield make
    for end in sockets:
        end.close()


def unit(host, kind, arm, credentials=None):
    return InstalledUnit(host / f"etc/systemd/system/{kind}@.service", arm, host, credentials)


def endpoint(host, arm):
    return re.search(r"tcp/127\.0\.0\.1:\d+", (host / f"etc/softarm/{arm}.toml").read_text())[0]


PROBE = """sh -c 'id -u; umask; pwd; ls /tmp /var/tmp /root /home /proc/pressure 2>/dev/null; echo writes; \
for place in . /tmp /etc /opt {prefix} {root}; do touch $place/probe 2>/dev/null && echo $place; done'"""


def test_the_conditions_are_those_of_the_unit(host, trees, supervisor, environment):
    probed = unit(host, "softarm", ARMS[0])
    probed._entries["ExecStart"] = [PROBE.format(prefix=environment, root=host)]
    with probed.running(trees, supervisor("probe").address) as process:
        told = process.communicate(timeout=20)[0].split("\n")
    assert told[:3] == [str(UID), "0027", f"{host}/var/lib/softarm/{ARMS[0]}"]
    seen, written = (part.split() for part in " ".join(told[3:]).split(" writes "))
    # Of what is hidden only what is installed for this test shows, and nothing of the host's own.
    assert {name.rstrip(":") for name in seen} <= {
        "/tmp",
        "/var/tmp",
        "/root",
        "/home",
        *host.parts,
        *(part for tree in trees for part in tree.parts),
    }
    assert written == [".", "/tmp"]


def test_a_service_asks_for_time_to_build_its_estimator_and_keeps_strangers_out(
    host, trees, supervisor, tmp_path
):
    """The control loop runs meanwhile, and passwords are those of the credentials that are handed over."""
    arm = ARMS[1]
    handed = host / "run/credentials"
    handed.mkdir(parents=True)
    with_users("users.json5", handed).rename(handed / "zenoh.json5")
    for file in (*handed.iterdir(), handed):
        os.chown(file, UID, UID)
        file.chmod(0o500 if file == handed else 0o400)  # as systemd leaves them
    operator = as_user("operator", tmp_path)
    socket = supervisor(arm)
    with unit(host, "softarm", arm, handed).running(trees, socket.address) as process:
        socket.wait_for("WATCHDOG=1", process)
        socket.wait_for("EXTEND_TIMEOUT_USEC=", process)
        with pytest.raises(UnreachableError):
            Arm(arm, endpoint(host, arm))
        with Arm(arm, endpoint(host, arm), zenoh_config=operator) as client:
            assert client.stop().mode == "FAULTED"
    assert process.returncode == 0
    assert (host / f"var/cache/softarm/{arm}/numba").is_dir()


def test_a_page_serves_and_waits_for_its_service(host, trees, supervisor):
    arm = ARMS[1]
    with unit(host, "softarm-page", arm).running(trees, supervisor(arm).address) as page:
        line = page.stdout.readline()
        assert line.startswith("operator page: http://127.0.0.1:"), page.stderr.read()
        assert f"<title>{arm}</title>" in fetched(line.split()[-1])
        assert "waiting for the service" in page.stderr.readline()
    assert page.returncode == 0


def fetched(address):
    with urllib.request.urlopen(address, timeout=20.0) as answer:
        return answer.read().decode()


def test_venting_after_the_service_ended_reads_the_same_configuration(host, trees, supervisor):
    vent = unit(host, "softarm", ARMS[0])
    vent._entries["ExecStart"] = vent._entries["ExecStopPost"]
    path = host / f"etc/softarm/{ARMS[0]}.toml"
    path.write_text(path.read_text().replace('host = "192.168.0.100"', 'host = "127.0.0.1"\nport = 1'))
    with vent.running(trees, supervisor("vent").address) as process:
        assert process.wait(60) == 1
        assert "valves" in process.stderr.read()


@pytest.mark.slow
def test_two_services_get_ready_command_their_arms_and_leave_recordings_for_their_group(
    host, trees, supervisor
):
    first, second = (unit(host, "softarm", arm) for arm in ARMS)
    left, right = supervisor("left"), supervisor("right")
    with first.running(trees, left.address) as process:
        left.wait_for("READY=1", process)
        seeded = second.folders()["CACHE_DIRECTORY"] / "numba"  # compiling once is enough
        shutil.copytree(host / f"var/cache/softarm/{ARMS[0]}/numba", seeded)
        subprocess.run(["chown", "-R", str(UID), seeded], check=True)
        with second.running(trees, right.address) as other:
            right.wait_for("READY=1", other)
            for arm in ARMS:
                recorded(host, arm)
            with unit(host, "softarm-page", ARMS[0]).running(trees, left.address) as page:
                assert page.stdout.readline().startswith("operator page: ")
                page.terminate()
                assert page.communicate(timeout=60)[1] == ""  # it would say that it waits


def recorded(host, arm):
    """Record for a moment; the file must be readable by the group and by nobody else."""
    with Arm(arm, endpoint(host, arm)) as client:
        begun = Path(client.recordings.start("x").path)
        since = client.state().ticks
        client.states().wait_for(lambda state: state.ticks > since + 50, 20.0)
        assert Path(client.recordings.stop().path) == begun
    folder = host / f"var/lib/softarm/{arm}"
    assert begun.is_relative_to(folder)
    assert oct(begun.stat().st_mode & 0o777) == "0o640"
    assert [oct(path.stat().st_mode & 0o7) for path in (folder, begun.parent)] == ["0o0"] * 2
    assert {path.stat().st_gid for path in (folder, begun.parent, begun)} == {UID}
    assert os.access(begun, os.R_OK)
