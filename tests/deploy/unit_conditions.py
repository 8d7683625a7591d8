"""The conditions under which systemd runs a unit, as far as a mount namespace can give them.

Read from the unit's own file: user, environment, folders, credentials, a read-only file system, a private
/tmp, hidden homes, and a /proc of processes alone. Not given: the filters of system calls and addresses.
"""

import os
import re
import shlex
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

UID = 61_234
"""A user without a name, as the service's own is to everything else on the host."""
HIDDEN = ("/tmp", "/var/tmp", "/home", "/root")
# Every mount here is one of the namespace alone; nothing is deleted.
SCRIPT = r"""
set -eu
keep=$1 write=$2; shift 2
mount --make-rprivate /
mount -t tmpfs tmpfs /mnt
number=0
for tree in $keep; do
    number=$((number + 1)); mkdir "/mnt/$number"; mount --rbind "$tree" "/mnt/$number"
done
for folder in $HIDDEN; do
    [ ! -d "$folder" ] || mount -t tmpfs -o mode=755 tmpfs "$folder"
done
chmod 1777 /tmp /var/tmp
number=0
for tree in $keep; do
    number=$((number + 1)); mkdir -p "$tree"; mount --rbind "/mnt/$number" "$tree"
done
umount -R -l /mnt
for folder in $write; do mount --bind "$folder" "$folder"; done
mount -t proc -o hidepid=invisible,subset=pid proc /proc
while read -r _ place _; do
    case " $write /tmp /var/tmp " in *" $place "*) continue ;; esac
    case $place in /proc | /dev* | /sys/fs/cgroup*) continue ;; esac
    mount -o remount,bind,ro "$place" 2>/dev/null || [ "$place" != / ]
done </proc/self/mounts
cd "$DIRECTORY"
umask "$MASK"
exec setpriv --reuid "$UNIT_UID" --regid "$UNIT_UID" --clear-groups --no-new-privs --bounding-set=-all \
    --inh-caps=-all -- env -i "$@"
"""


def refusal() -> str:
    """Return why this host gives no namespace, empty where it does."""
    if shutil.which("unshare") is None or shutil.which("setpriv") is None:
        return "unshare and setpriv of util-linux are not installed"
    if os.geteuid() != 0:
        return "only root may change the user and mount within a namespace"
    tried = subprocess.run(
        ["unshare", "--mount", "sh", "-c", "mount --make-rprivate / && mount -t tmpfs tmpfs /mnt"],
        capture_output=True,
        text=True,
        check=False,
    )
    return tried.stderr.strip()


@dataclass(frozen=True)
class InstalledUnit:
    """A unit of one arm as ``deploy/install`` left it below another root.

    Args:
        path: The unit's file.
        arm: What stands for ``%i``.
        root: Folder that stands for ``/``.
        credentials: Folder with what ``LoadCredential`` hands over, by the names within the unit.
    """

    path: Path
    arm: str
    root: Path
    credentials: Path | None = None
    _entries: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, value in re.findall(r"^(\w+)=(.*)$", self.path.read_text(), re.M):
            self._entries.setdefault(key, []).append(self._expanded(value))

    def _expanded(self, text: str) -> str:
        places = {"%i": self.arm, "%E": f"{self.root}/etc"}
        places |= {"%S": f"{self.root}/var/lib", "%C": f"{self.root}/var/cache"}
        return re.sub("|".join(places), lambda match: places[match[0]], text)

    def entry(self, key: str, default: str = "") -> str:
        """Return the last value of a key."""
        return self._entries.get(key, [default])[-1]

    def folders(self) -> dict[str, Path]:
        """Make the unit's state and cache, owned by its user; by the variables that name them."""
        made = {}
        for kind, below in (("State", "var/lib"), ("Cache", "var/cache")):
            if name := self.entry(f"{kind}Directory"):
                folder = self.root / below / name
                folder.mkdir(parents=True, exist_ok=True)
                folder.chmod(int(self.entry(f"{kind}DirectoryMode", "0755"), 8))
                os.chown(folder, UID, UID)
                made[f"{kind.upper()}_DIRECTORY"] = folder
        return made

    def environment(self, folders: dict[str, Path], notify: str) -> list[str]:
        """List the variables that systemd sets, and no other."""
        given = {"PATH": "/usr/bin:/bin", "HOME": "/", "USER": "softarm", "NOTIFY_SOCKET": notify}
        given |= {name: str(folder) for name, folder in folders.items()}
        if self.credentials is not None:
            handed = {entry.split(":")[0] for entry in self._entries["LoadCredential"]}
            assert {file.name for file in self.credentials.iterdir()} <= handed
            given["CREDENTIALS_DIRECTORY"] = str(self.credentials)
        listed = [f"{name}={value}" for name, value in given.items()]
        return listed + [word for entry in self._entries.get("Environment", []) for word in entry.split()]

    @contextmanager
    def running(self, trees: Sequence[Path], notify: str) -> Iterator[subprocess.Popen[str]]:
        """Run the unit's command under its conditions.

        Args:
            trees: What is installed: it stays where it is, readable, also below a hidden folder.
            notify: Address of the supervisor's socket.
        """
        assert self.entry("ProtectSystem") == "strict"
        assert self.entry("PrivateTmp") == self.entry("ProtectHome") == "yes"
        folders = self.folders()
        keep = [str(tree) for tree in (*trees, self.root)]
        write = [str(folder) for folder in folders.values()]
        words = ["unshare", "--mount", "sh", "-c", SCRIPT, "unit", " ".join(keep), " ".join(write)]
        words += [*self.environment(folders, notify), *shlex.split(self.entry("ExecStart"))]
        shell = {
            "HIDDEN": " ".join(HIDDEN),
            "DIRECTORY": self.entry("WorkingDirectory", "/"),
            "MASK": self.entry("UMask", "0022"),
            "UNIT_UID": str(UID),
        }
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        with subprocess.Popen(words, env=os.environ | shell, text=True, **pipes) as process:
            try:
                yield process
            finally:
                if process.poll() is None:
                    process.terminate()
                    process.communicate(timeout=60)


class SupervisorSocket:
    """The socket on which a unit notifies its supervisor; abstract, so that every namespace reaches it."""

    def __init__(self, name: str) -> None:
        self.address = f"@softarm-test-{os.getpid()}-{name}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(f"\0{self.address[1:]}")
        self.heard: list[str] = []

    def wait_for(self, words: str, process: subprocess.Popen[str], silence_s: float = 60.0) -> None:
        """Wait for a message; fail when the process ends or is silent for too long."""
        self._socket.settimeout(silence_s)
        while not self.heard or words not in self.heard[-1]:
            assert process.poll() is None, process.communicate()[1]
            self.heard.append(self._socket.recv(4096).decode())

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
