"""``softarm doctor`` against what is there and what is not."""

import asyncio
import json
import re
import socket
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from softarm.cli import doctor
from softarm.cli.doctor import CheckTally, command, describe, examine, read_devices, tables
from softarm.drivers.errors import ConnectionLost
from softarm.drivers.reading import Reading
from softarm.estimator.errors import InputError
from softarm.fakes.rig import running
from softarm.fakes.scenario import check_scenario
from tests.drivers.valve_rig import MemoryTerminal, build

ROOT = Path(__file__).parents[2]


@pytest.fixture
def closed_port():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        yield taken.getsockname()[1]


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


VALVES = """
arm = "left"
[[devices]]
name = "valves"
kind = "festo_mpa"
host = "127.0.0.1"
port = {port}
chambers = [3, 2, 1, 0, 4, 5]
maximum_pa = 50000.0
"""


def test_a_device_that_is_not_there_is_told_with_its_cure(tmp_path, closed_port):
    path = write(tmp_path / "arm.toml", VALVES.format(port=closed_port))
    result = CliRunner().invoke(
        command, ["--config", str(path), "--seconds", "0.1", "--json"], standalone_mode=False
    )
    assert result.return_value == 1
    devices, findings = json.loads(result.stdout)["tables"]
    assert devices["rows"][0]["state"] == "fault"
    assert devices["rows"][0]["address"] == f"modbus+tcp://127.0.0.1:{closed_port}"
    assert devices["notes"][0] == "0 of 1 devices work. No set-point was written."
    assert "does not accept a connection" in findings["rows"][0]["finding"]
    assert findings["rows"][0]["remedy"] == "check address, cable and power of the terminal"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = [", "is not TOML"),
        ("arm = 'left'", "names no devices"),
        ("devices = 3", "names no devices"),
        (VALVES.format(port=0), "greater than or equal to 1"),
    ],
)
def test_a_wrong_file_is_told(tmp_path, text, told):
    with pytest.raises(InputError, match=told):
        read_devices(write(tmp_path / "arm.toml", text))


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_devices(tmp_path / "none.toml")


class OnTerminal:
    """A configuration whose device talks to a terminal in memory."""

    name = "valves"
    kind = "festo_mpa"

    def __init__(self, virtual, terminal):
        self.virtual = virtual
        self.terminal = terminal

    def build(self, sink, *, observe):
        return build(self.virtual, self.terminal, sink, observe=observe)


def test_what_answers_is_told_and_nothing_is_written(virtual):
    async def main():
        terminal = MemoryTerminal(virtual.clock, watchdog_ms=400)
        terminal.diagnosis[3] = 26
        terminal.setpoints[5] = 120
        found = await examine(OnTerminal(virtual, terminal), 1.0)
        assert terminal.log == []
        return found

    found = virtual.run(main)
    assert found.row["rate_hz"] == pytest.approx(100, abs=2)
    assert found.row["state"] == "degraded"
    (finding,) = found.findings
    assert (finding.serious, "valve 3 of chamber 0 reports a fault (0x001a)") == (True, finding.what)
    assert found.facts["watchdog"] == "vents after 400 ms of silence"
    assert found.facts["set-points found"] == "valve 5: 120"
    assert [table.title for table in tables([found])] == [
        "Devices",
        "Findings",
        "Device status",
    ]


def test_counters_and_invalid_readings_are_remarks(virtual):
    async def main():
        bank = build(virtual, MemoryTerminal(virtual.clock), observe=True)
        await bank.connect()
        tally = CheckTally()
        for index in range(3):
            tally.add(Reading("valves", None, None, index * 10**7, 0, index, 0, index > 0, "x", ("late",)))
        bank.health.gaps = 4
        found = describe(OnTerminal(virtual, None), bank, tally)
        await bank.close()
        return found

    found = virtual.run(main)
    assert [finding.serious for finding in found.findings] == [False, False]
    assert "1 invalid readings: late" in found.findings[0].what
    assert "4 samples that never arrived" in found.findings[1].what
    assert found.row["rate_hz"] == pytest.approx(100)


def test_a_source_that_ran_late_is_reported_by_its_own_clock(virtual):
    """The readings were measured every 10 ms; the third, and with it a burst, arrived 80 ms late."""

    async def main():
        bank = build(virtual, MemoryTerminal(virtual.clock), observe=True)
        await bank.connect()
        tally = CheckTally()
        for index, transit_ms in enumerate((4, 5, 84, 74, 4)):
            measured_ns = index * 10**7
            arrival_ns = measured_ns + transit_ms * 10**6
            tally.add(Reading("qtm", None, measured_ns, arrival_ns, measured_ns, index, 0, True, "x"))
        found = describe(OnTerminal(virtual, None), bank, tally)
        await bank.close()
        return found

    (finding,) = virtual.run(main).findings
    assert not finding.serious
    assert finding.what == "readings came up to 80 ms late, by the device's own clock"


def test_doctor_says_when_it_came_late_itself(closed_port, tmp_path):
    configs = read_devices(write(tmp_path / "arm.toml", VALVES.format(port=closed_port)))

    def keep_busy(_):
        until = time.monotonic() + 0.05
        while time.monotonic() < until:
            pass

    found, busy = asyncio.run(doctor.examine_all(configs, 0.3, keep_busy))
    assert re.fullmatch(r"doctor itself came (\d+) ms late", busy)
    assert f"This machine is busy: {busy}." in tables(found, busy)[0].notes[1]
    assert len(tables(found)[0].notes) == 1


@pytest.mark.parametrize(
    ("late_ns", "starved", "busy"),
    [
        (10**6, 5.0, ""),
        (10**6, None, ""),
        (30 * 10**6, 90.0, "doctor itself came 30 ms late"),
        (10**6, 90.0, "programs waited for the processor 90 % of the time"),
    ],
)
def test_a_source_on_this_machine_may_starve_while_doctor_does_not(late_ns, starved, busy):
    assert doctor._busy(late_ns, starved) == busy


def test_the_last_error_is_told_without_its_device():
    error = ConnectionLost("valves", "did not answer", "check the cable", limit=0.1, unit="s")
    finding = doctor._of_error("valves", error)
    assert (finding.what, finding.cure) == ("did not answer (limit 0.1 s)", "check the cable")


def test_a_qualisys_host_is_discovered(capsys):
    scenario = {"name": "discovery", "device": [{"name": "qtm", "kind": "qualisys", "discovery_port": 0}]}

    async def found():
        async with running(check_scenario(scenario)) as rig:
            (endpoint,) = rig.endpoints()
            port = endpoint.discovery_port
            return endpoint.port, await asyncio.to_thread(
                CliRunner().invoke, command, ["--discover", f"127.0.0.1:{port}", "--json"]
            )

    port, result = asyncio.run(found())
    (row,) = json.loads(result.stdout)["rows"]
    assert (row["address"], row["port"]) == ("127.0.0.1", port)


def test_no_qualisys_host_is_status_1(closed_port):
    result = CliRunner().invoke(
        command, ["--discover", f"127.0.0.1:{closed_port}", "--json"], standalone_mode=False
    )
    assert result.return_value == 1
    assert json.loads(result.stdout)["rows"] == []


def test_either_a_configuration_or_an_address_is_needed():
    assert CliRunner().invoke(command, []).exit_code == 2


def test_a_configuration_that_the_service_refuses_is_refused_before_any_device_is_opened(tmp_path):
    example = (ROOT / "deploy" / "config" / "sopra.toml").read_text("utf-8")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(example.replace("[control]", "[control]\nrate_hzz = 3", 1))
    with pytest.raises(InputError, match=r"control\.rate_hzz: unknown key; did you mean 'rate_hz'"):
        read_devices(wrong)
