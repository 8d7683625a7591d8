"""``softarm fakes`` as a process: the ready line, the control port, the end."""

import asyncio
import json
import signal
import sys

import tomli_w

from softarm.cli import run

TABLE = {
    "name": "small",
    "plant": {"kind": "still"},
    "device": [{"name": "valves", "kind": "festo_mpa"}, {"name": "gauge", "kind": "lutron"}],
}


def links(folder):
    return [path.name for path in folder.iterdir()]


async def test_ready_line_control_and_end(tmp_path):
    scenario = tmp_path / "small.toml"
    scenario.write_text(tomli_w.dumps({**TABLE, "runtime_dir": str(tmp_path / "run")}))
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "softarm", "fakes", "--scenario", str(scenario), "--json",
        stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    ready = json.loads(await asyncio.wait_for(process.stdout.readline(), 60))
    assert ready["ready"] is True
    assert [device["kind"] for device in ready["devices"]] == ["festo_mpa", "lutron"]
    assert links(tmp_path / "run") == ["gauge"]
    host, port = ready["control"].split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(b'{"do": "fault", "device": "gauge", "fault": "unplug"}\n')
    assert json.loads(await reader.readline()) == {"ok": True}
    assert links(tmp_path / "run") == []
    process.send_signal(signal.SIGTERM)
    out, err = await asyncio.wait_for(process.communicate(), 60)
    *busy, last = err.splitlines()
    assert (process.returncode, out, last) == (0, b"", b"fakes: stopped")
    assert len(busy) <= 1
    assert all(line.startswith(b"fakes: this machine is busy") for line in busy)
    writer.close()
    assert links(tmp_path / "run") == []


def test_a_mistake_is_one_line_and_status_2(tmp_path, capsys):
    scenario = tmp_path / "wrong.toml"
    scenario.write_text(tomli_w.dumps({**TABLE, "sead": 1}))
    assert run(["fakes", "--scenario", str(scenario)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_faults_are_listed(tmp_path, capsys):
    scenario = tmp_path / "small.toml"
    scenario.write_text(tomli_w.dumps(TABLE))
    assert run(["fakes", "--scenario", str(scenario), "--faults", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {(row["device"], row["fault"]) for row in rows} >= {("valves", "freeze"), ("gauge", "unplug")}
