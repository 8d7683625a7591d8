"""Looking at the processes of a running service."""

from pathlib import Path


def child_of(pid: int) -> int:
    """Find the estimator's process: the largest child; 0 when there is none."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return 0
    return max((int(child) for child in children), key=resident_kib, default=0)


def resident_kib(pid: int) -> int:
    """Return the resident memory of a process [KiB]; 0 when it is gone."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("VmRSS")), 0)
