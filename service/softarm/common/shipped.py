"""Files that travel with the fakes: what commands start when they are given no scenario of their own."""

from importlib import resources
from pathlib import Path

DEMO_SCENARIO = "demo"
"""Valve terminal, motion capture, force gauge and bend sensors; ``softarm fakes`` knows it by this name."""


def fake_specimen() -> Path:
    """Return the specimen calibrated on the fake arm."""
    return Path(str(resources.files("softarm.fakes") / "specimens" / "fake_arm.toml"))
