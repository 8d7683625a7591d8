"""The units as shipped, installed by the installer and started by a real systemd in namespaces of its own."""

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from tests.deploy.conftest import same_version

HERE = Path(__file__).parent
SYSTEMD = Path("/lib/systemd/systemd")
NAMESPACES = ("--mount", "--pid", "--fork", "--uts", "--ipc", "--net", "--cgroup", "--mount-proc")
PATIENCE_S = 400.0
pytestmark = pytest.mark.timeout(900)


class Host:
    """A systemd that runs within the block.

    Args:
        work: Folder of what it writes.
        prefix: What stands in /opt/softarm.
    """

    def __init__(self, work, prefix):
        self._log = (work / "host.log").open("w")
        self._process = subprocess.Popen(
            ["unshare", *NAMESPACES, HERE / "host.sh", work, prefix], stdout=self._log, stderr=self._log
        )
        self.log = work / "host.log"

    def _children(self):
        """Return the first process of the namespaces, once it is there."""
        file = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        while self._process.poll() is None:
            if children := file.read_text().split():
                return children
        raise AssertionError(self.log.read_text())

    def run(self, *command, check=True):
        """Run a command in the namespaces."""
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text().split()
        return subprocess.run(
            [
                "nsenter",
                "-t",
                children[0],
                "--mount",
                "--pid",
                "--uts",
                "--ipc",
                "--net",
                "--cgroup",
                *command,
            ],
            capture_output=True,
            text=True,
            check=check,
        )

    def until(self, state, unit, seconds=PATIENCE_S):
        """Wait until a unit is in a state."""
        end = time.monotonic() + seconds
        while (now := self.run("systemctl", "is-active", unit, check=False).stdout.strip()) != state:
            assert time.monotonic() < end, (unit, now, self.log.read_text()[-3000:])
            assert now != "failed", self.log.read_text()[-3000:]
            subprocess.run(["sleep", "1"], check=True)

    def end(self):
        """Kill the namespaces with all in them."""
        for child in self._children():
            os.kill(int(child), 9)
        self._process.wait()
        self._log.close()


@pytest.fixture(scope="module")
def host(environment, tmp_path_factory):
    if os.geteuid() != 0 or not SYSTEMD.exists() or shutil.which("unshare") is None:
        pytest.skip("needs root, unshare and systemd")
    if not same_version():
        pytest.skip("needs a /usr/bin/python3 of this version: units may not read home directories")
    allowed = subprocess.run(["unshare", *NAMESPACES, "true"], capture_output=True, text=True, check=False)
    if allowed.returncode:
        pytest.skip(f"namespaces are not permitted here: {allowed.stderr.strip()}")
    script = environment / "bin" / "softarm"
    text = script.read_text().splitlines()
    prefix = tmp_path_factory.mktemp("prefix")
    shutil.copytree(environment, prefix / "venv", symlinks=True)
    (prefix / "venv/bin/softarm").write_text("\n".join(["#!/opt/softarm/venv/bin/python", *text[1:], ""]))
    for part in (prefix, prefix.parent, prefix.parent.parent):
        part.chmod(0o755)
    host = Host(tmp_path_factory.mktemp("host"), prefix)
    try:
        end = time.monotonic() + 30.0
        while host.run("test", "-S", "/run/systemd/private", check=False).returncode:
            assert time.monotonic() < end, host.log.read_text()
        yield host
    finally:
        host.end()


def test_two_arms_and_their_pages_run_on_one_host(host):
    for name in ("left", "right"):
        host.run(HERE.parents[1] / "deploy" / "install", "--no-venv", name)
        host.run("sed", "-i", "s/192.168.0.10[01]/127.0.0.1/", f"/etc/softarm/{name}.toml")
        host.run("systemctl", "start", "--no-block", f"softarm@{name}")
    for name in ("left", "right"):
        host.until("active", f"softarm@{name}")
        host.run("systemctl", "start", "--no-block", f"softarm-page@{name}")
    for name, port in (("left", 8080), ("right", 8081)):
        host.until("active", f"softarm-page@{name}", 60.0)
        page = "import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1], timeout=5).status)"
        address = f"http://127.0.0.1:{port}"
        end = time.monotonic() + 120.0
        while host.run("python3", "-c", page, address, check=False).stdout.strip() != "200":
            assert time.monotonic() < end, host.log.read_text()[-3000:]
        softarm = ["setpriv", "--reuid=softarm", "--regid=softarm", "--clear-groups"]
        record = ["/opt/softarm/venv/bin/softarm", "record", "--arm", name, "--seconds", "1"]
        endpoint = f"tcp/127.0.0.1:{port - 8080 + 7447}"
        made = host.run(*softarm, *record, "--endpoint", endpoint, check=False)
        assert made.returncode == 0, made.stderr
        file = f"/var/lib/softarm/{name}/recordings/recording.mcap"
        rights = host.run("stat", "-c", "%a %U:%G", file, f"/var/lib/softarm/{name}").stdout.split("\n")
        assert rights[:2] == ["640 softarm:softarm", "2750 softarm:softarm"]


def test_a_wrong_configuration_is_not_retried(host):
    host.run("sh", "-c", "echo 'wrong = 1' > /etc/softarm/broken.toml")
    host.run("systemctl", "start", "softarm@broken", check=False)
    end = time.monotonic() + 60.0
    while host.run("systemctl", "is-failed", "softarm@broken", check=False).stdout.strip() != "failed":
        assert time.monotonic() < end
    shown = host.run("systemctl", "show", "-p", "NRestarts", "-p", "ExecMainStatus", "softarm@broken").stdout
    assert "NRestarts=0" in shown
    assert "ExecMainStatus=2" in shown
