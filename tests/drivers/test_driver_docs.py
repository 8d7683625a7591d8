"""docs/drivers.md tells every kind and every key, and its example loads."""

import re
import tomllib
from pathlib import Path

import pytest

from softarm.drivers.registry import KINDS, load_devices
from softarm.drivers.supervisor import TRANSITIONS, ConnectionState

PAGE = (Path(__file__).parents[2] / "docs" / "drivers.md").read_text(encoding="utf-8")


def test_the_example_loads():
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    devices = load_devices(tomllib.loads(example)["devices"])
    assert [device.name for device in devices] == ["valves", "qtm", "gauge", "bend", "imu"]


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_and_key_is_told(kind):
    assert f"`{kind}`" in PAGE
    for key in KINDS[kind].model_fields:
        assert f"`{key}`" in PAGE, f"{kind}: {key}"


@pytest.mark.parametrize("state", list(ConnectionState))
def test_every_state_is_told_with_what_follows(state):
    (row,) = re.findall(rf"^\| `{state}` \|.*\| (.*) \|$", PAGE, re.MULTILINE)
    told = set(re.findall(r"`(\w+)`", row))
    assert told == {str(after) for after in TRANSITIONS[state] if after is not ConnectionState.DISCONNECTED}
