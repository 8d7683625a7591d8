"""The drivers as the control loop sees them: real ones, of which no device answers."""

import logging
import socket
from dataclasses import replace

import pytest

from softarm.daemon.control.instruments import LiveInstruments
from softarm.drivers.registry import load_devices
from softarm.estimator.errors import InputError
from tests.service.standins import setup_in


@pytest.fixture
def port():
    with socket.socket() as nobody:  # bound and not listening: connections are refused
        nobody.bind(("127.0.0.1", 0))
        yield nobody.getsockname()[1]


def instruments(folder, *tables):
    return LiveInstruments(replace(setup_in(folder), devices=load_devices(tables)), lambda _: None)


def valves(port):
    named = {"name": "valves", "kind": "festo_mpa", "host": "127.0.0.1", "port": port}
    return named | {"chambers": list(range(6)), "maximum_pa": 65e3}


async def test_devices_that_do_not_answer_are_logged_and_the_others_go_on(tmp_path, port, caplog):
    gauge = {"name": "gauge", "kind": "mark10", "port": str(tmp_path / "no_port")}
    live = instruments(tmp_path, valves(port), gauge)
    try:
        with caplog.at_level(logging.WARNING):
            await live.connect()
        assert any("valves" in line for line in caplog.messages)
        assert any("no_port" in line for line in caplog.messages)
        status = {device.name: device for device in live.devices()}
        assert not status["gauge"].connected
        assert "no_port" in status["gauge"].error + status["gauge"].cure
        assert not live.applied.any()
        with pytest.raises(KeyError):
            await live.reconnect("nobody")
    finally:
        await live.close()


def test_a_service_has_one_valve_bank(tmp_path, port):
    with pytest.raises(InputError, match="0 valve banks; configure one device"):
        instruments(tmp_path)
