"""Folders and credentials that systemd passes to a unit in the environment."""

import os
from pathlib import Path

ZENOH = "zenoh.json5"
UNIT_FOLDERS = {"state_directory": "", "recording_directory": "recordings"}
"""Where these folders of a configuration are in the state directory of a unit."""


def state_directory() -> Path | None:
    """Return the unit's ``StateDirectory=``, None outside a unit."""
    return _folder("STATE_DIRECTORY")


def zenoh_credential() -> Path | None:
    """Return the zenoh settings that the unit got by ``LoadCredential=``, None where there are none."""
    folder = _folder("CREDENTIALS_DIRECTORY")
    file = None if folder is None else folder / ZENOH
    return file if file is not None and file.is_file() else None


def _folder(variable: str) -> Path | None:
    text = os.environ.get(variable, "").split(":")[0]
    return Path(text) if text else None
