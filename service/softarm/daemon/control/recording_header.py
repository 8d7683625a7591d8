"""The header of every recording of a service: where it comes from."""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from softarm.daemon.config import Setup


def recording_header(setup: Setup) -> dict[str, Any]:
    """Return arm, specimen, configuration, version and host as entries of ``recording.toml``.

    The specimen is the name of a shipped one or the path of a file, as ``--specimen`` accepts it.
    """
    local = setup.path.parent / setup.config.specimen
    return {
        "arm": setup.config.arm,
        "specimen": str(local.resolve()) if local.is_file() else setup.config.specimen,
        "configuration": str(setup.path.resolve()),
        "softarm_version": _version(),
        "host": platform.node(),
        "pressure_unit": "Pa",
    }


def _version() -> str:
    try:
        return version("softarm")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "unknown"
