"""The configuration that a rig writes for its service, and the priority that its processes have."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from softarm.daemon.config import SafetySettings
from softarm.drivers.valves.bank import MpaConfig
from softarm.drivers.valves.config import ValveConfig
from softarm.experiments.rig import UNIT_NICENESS, VALVE_WAITS, WAITS, RigSettings, niceness, service_config

VALVES = {"name": "valves", "kind": "festo_mpa", "host": "localhost", "port": 502, "valve_map": [*range(6)]}


@pytest.mark.parametrize("patience", [1.0, 5.0])
def test_a_patient_rig_waits_longer_for_everything_that_may_be_silent(patience: float) -> None:
    table = service_config(RigSettings("demo", patience=patience), [VALVES])
    usual = SafetySettings().model_dump()
    assert table["safety"] == {name: patience * usual[name] for name in WAITS}
    known = {k: v for k, v in table["devices"][0].items() if k in ValveConfig.model_fields}
    terminal = MpaConfig.model_validate(known)
    for name in VALVE_WAITS:
        assert getattr(terminal, name) == pytest.approx(patience * ValveConfig.model_fields[name].default)


def test_the_service_of_a_rig_is_as_nice_as_its_unit() -> None:
    unit = Path(__file__).parents[3] / "deploy" / "systemd" / "softarm@.service"
    assert f"Nice={UNIT_NICENESS}\n" in unit.read_text()


def test_a_process_is_started_with_a_niceness_and_this_one_keeps_its_own() -> None:
    own = os.nice(0)
    with niceness(UNIT_NICENESS):
        inside = os.nice(0)
        words = [sys.executable, "-c", "import os; print(os.nice(0))"]
        told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert int(told) == inside
    assert inside == UNIT_NICENESS or os.geteuid() != 0
    assert os.nice(0) == own
