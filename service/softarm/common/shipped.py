"""Files that travel with the fakes: what commands start when the user names no scenario."""

from importlib import resources
from pathlib import Path

DEMO_SCENARIO = "demo"
"""Valve terminal, motion capture, force gauge and bend sensors; ``softarm fakes`` finds it by this name."""


def fake_specimen() -> Path:
    """Return the specimen calibrated on the fake arm."""
    return Path(str(resources.files("softarm.fakes") / "specimens" / "fake_arm.toml"))
