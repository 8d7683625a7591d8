"""The installer itself, on an /etc and an /opt that exist in a mount namespace alone, with small wheels."""

import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

from tests.deploy.unit_conditions import refusal

REASON = refusal()
pytestmark = [
    pytest.mark.skipif(bool(REASON), reason=f"no mount namespace: {REASON}"),
    pytest.mark.skipif(not Path("/usr/bin/python3").exists(), reason="the system has no Python"),
    pytest.mark.timeout(300),
]
DEPLOY = Path(__file__).parents[2] / "deploy"
NAMESPACE = """
set -u
mount --make-rprivate /
mount -t tmpfs tmpfs /mnt
mkdir /mnt/changed /mnt/work
mount -t overlay overlay -o lowerdir=/etc,upperdir=/mnt/changed,workdir=/mnt/work /etc
mount -t tmpfs tmpfs /opt
installed() {
    echo "status $?"
    find /opt /etc/softarm /etc/systemd/system/softarm* -name 'only_*' -o -name '*.toml*' -o -name 'venv*' \
        -o -name 'softarm*.service' 2>/dev/null | sed 's/venv-[0-9]*/venv-N/' | sort -u
}
"""
SYSTEMCTL = """#!/bin/sh
case "$*" in *is-active*) [ -e "$(dirname "$0")/a-service-runs" ] ;; esac
"""


def wheel(folder, version, only):
    """Write a wheel whose command prints its version and that holds one file of its own."""
    info = f"softarm-{version}.dist-info"
    files = {
        "softarm_stub.py": f"def main():\n    print('softarm, version {version}')\n",
        f"{only}.py": "",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: softarm\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": "[console_scripts]\nsoftarm = softarm_stub:main\n",
    }
    record = "".join(f"{name},,\n" for name in (*files, f"{info}/RECORD"))
    path = folder / f"softarm-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in {**files, f"{info}/RECORD": record}.items():
            archive.writestr(name, text)
    return path


@pytest.fixture
def run(tmp_path):
    """Run shell lines in the namespace; returns what they print on both streams."""
    checkout, tools = tmp_path / "checkout", tmp_path / "tools"
    shutil.copytree(DEPLOY, checkout / "deploy")
    (checkout / "deploy" / "requirements.lock").write_text(
        "# nothing: the wheels of this test need nothing\n"
    )
    tools.mkdir()
    for name in ("systemctl", "systemd-sysusers", "udevadm"):  # those of the host must not act
        (tools / name).write_text(SYSTEMCTL)
        (tools / name).chmod(0o755)
    wheel(tmp_path, "1.0", "only_old")
    wheel(tmp_path, "2.0", "only_new")

    def start(lines):
        environment = {"PATH": f"{tools}:/usr/sbin:/usr/bin:/sbin:/bin", "HERE": str(tmp_path)}
        environment |= {"PYTHON": "/usr/bin/python3", "HOME": str(tmp_path), "PIP_NO_INDEX": "1"}
        install = 'install() { "$HERE/checkout/deploy/install" "$@"; installed; }\n'
        return subprocess.run(
            ["unshare", "--mount", "sh", "-c", NAMESPACE + install + lines],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
            check=False,
        ).stdout.splitlines()

    return start


def host():
    return sorted(Path("/opt").iterdir()), Path("/etc/softarm").exists()


def test_an_upgrade_leaves_nothing_of_the_old_version_and_does_not_replace_a_running_one(run):
    before = host()
    told = run(
        """
        install --wheel "$HERE/softarm-1.0-py3-none-any.whl" left >"$HERE/first"
        cp /etc/softarm/left.toml "$HERE/kept"; echo '# edited' >>/etc/softarm/left.toml
        touch "$HERE/tools/a-service-runs"
        install --wheel "$HERE/softarm-2.0-py3-none-any.whl" left; echo ---
        rm "$HERE/tools/a-service-runs"
        install --wheel "$HERE/softarm-2.0-py3-none-any.whl" left; tail -n 1 /etc/softarm/left.toml; echo ---
        install --uninstall left
        """
    )
    refused, upgraded, removed = "\n".join(told).split("\n---\n")
    assert refused.startswith("deploy/install: a service runs on the version to be replaced; stop it first")
    assert refused.splitlines()[1] == "status 1"
    assert "only_old.py" in refused
    assert "only_new.py" not in refused
    assert "softarm, version 2.0" in upgraded
    assert "only_new.py" in upgraded
    assert "only_old.py" not in upgraded
    assert upgraded.splitlines().count("/opt/softarm/venv-N") == 1
    assert upgraded.splitlines()[-1] == "# edited"
    assert "left.toml.removed" in removed
    assert "/opt/softarm" not in removed.split("status 0")[1]
    assert ".service" not in removed.split("status 0")[1]
    assert host() == before, "the test left its namespace"


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        ("export PYTHON=/nowhere/python3", "Python 3.11 or newer is needed"),
        (
            "mount -t tmpfs tmpfs /root; cp -L /usr/bin/python3 /root; export PYTHON=/root/python3",
            "is in a home directory, where the services may not read",
        ),
    ],
    ids=["no interpreter", "interpreter in a home directory"],
)
def test_what_cannot_be_installed_is_refused_in_one_line_and_leaves_nothing(run, prepare, words):
    told = run(f'{prepare}\ninstall --wheel "$HERE/softarm-1.0-py3-none-any.whl" left')
    assert words in told[0]
    assert told[0].startswith("deploy/install: ")
    assert told[1] == "status 1"
    assert told[2:] == []
