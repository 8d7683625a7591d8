"""The configuration that a rig writes for its service."""

import pytest

from softarm.daemon.config import SafetySettings
from softarm.drivers.valves.config import MpaConfig, ValveConfig
from softarm.experiments.rig import VALVE_WAITS, WAITS, RigSettings, service_config

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
