"""The byte vectors of the manuals, which the fakes must produce; they never saw an encoder of ours."""

import tomllib
from pathlib import Path

import pytest

from softarm.fakes.faults import FaultBoard
from softarm.fakes.qtm import packets
from softarm.fakes.qtm.discovery import discovery_reply
from softarm.fakes.qtm.packets import MeasuredFrame, PacketBody
from softarm.fakes.qtm.session import WELCOME
from softarm.fakes.serial.bno import MILLI_G, rvc_frame
from softarm.fakes.serial.lutron import lutron_frame
from softarm.fakes.serial.sauter import sauter_reply
from softarm.fakes.serial.witmotion import witmotion_frame
from softarm.fakes.serial.xbus import DATA, xbus_message
from softarm.fakes.signals import unmodified
from softarm.fakes.valves.modbus import MBAP, execute
from softarm.fakes.valves.mpa import MpaBank, bank_faults
from softarm.fakes.valves.node import CpxNode, node_faults
from softarm.fakes.valves.pneumatics import Regulators

VECTORS = tomllib.loads((Path(__file__).parents[1] / "drivers" / "vectors.toml").read_text())


def octets(text):
    return bytes.fromhex(text)


@pytest.fixture
def node():
    faults = FaultBoard("valves", (*node_faults(16), *bank_faults(16)))
    return CpxNode(MpaBank(faults, 16, Regulators(), 0, unmodified), faults)


def ask(node, frame):
    """Serve one frame as the port does."""
    transaction, protocol, length, unit = MBAP.unpack_from(frame)
    assert protocol == 0
    assert length == len(frame) - 6
    answer = execute(node, frame[MBAP.size :])
    return MBAP.pack(transaction, 0, len(answer) + 1, unit) + answer


def test_modbus_read_of_all_valves(node):
    vector = VECTORS["modbus"]["read_all"]
    reply = ask(node, octets(vector["bytes"]))
    assert len(reply) == vector["reply_length"]
    assert reply[:9] == octets("00 01 00 00 00 63 01 03 60")


def test_modbus_write_of_all_valves(node):
    vector = VECTORS["modbus"]["write_all"]
    assert ask(node, octets(vector["bytes"])) == octets(vector["reply"])
    node.update(0.001)
    assert node.read(45396, 1) == [350]


def test_modbus_exchange_of_all_valves(node):
    reply = ask(node, octets(VECTORS["modbus"]["exchange_all"]["bytes"]))
    assert reply[:9] == octets("00 03 00 00 00 63 01 17 60")
    assert node.read(40003, 2) == [350, 0]


def test_modbus_exception_to_an_exchange(node):
    frame = bytearray(octets(VECTORS["modbus"]["exchange_all"]["bytes"]))
    frame[8:10] = octets("ff 00")
    assert ask(node, bytes(frame)) == octets(VECTORS["modbus"]["exchange_all"]["exception_reply"])


def test_modbus_watchdog(node):
    frame = octets(VECTORS["modbus"]["watchdog"]["bytes"])
    assert ask(node, frame) == frame
    assert node.read(46100, 1) == [100]


def test_qtm_packets():
    vector = VECTORS["qtm"]
    head = octets(vector["welcome"]["bytes"])
    assert packets.text(packets.COMMAND, WELCOME) == head + vector["welcome"]["text"].encode()
    assert packets.packet(packets.NO_MORE_DATA) == octets(vector["no_more_data"]["bytes"])
    assert packets.event(1) == octets(vector["event_connected"]["bytes"])
    reply, port = discovery_reply(octets(vector["discover"]["bytes"]), 22222)
    assert port == 45454
    assert reply[:8] == len(reply).to_bytes(4, "little") + octets("01 00 00 00")
    assert reply[-2:] == octets("56 ce")


def test_qtm_frame():
    vector = VECTORS["qtm"]["frame_6d"]
    body = PacketBody(tuple(vector["position_mm"]), tuple(vector["rotation"]), 0.1)
    frame = MeasuredFrame(vector["timestamp_us"], vector["frame"], [body, None])
    assert packets.data_packet(frame, ["6d"]) == octets(vector["bytes"])


@pytest.mark.parametrize("vector", VECTORS["lutron"])
def test_lutron(vector):
    assert lutron_frame(vector["value"], vector["unit"]) == octets(vector["bytes"])


@pytest.mark.parametrize("vector", VECTORS["sauter"])
def test_sauter(vector):
    assert sauter_reply(vector["value"]) == vector["text"].encode()


@pytest.mark.parametrize("vector", VECTORS["bno_rvc"])
def test_bno_rvc(vector):
    acceleration = tuple(MILLI_G * value for value in vector["acceleration_mg"])
    frame = rvc_frame(vector["index"], tuple(vector["yaw_pitch_roll_deg"]), acceleration)
    assert frame == octets(vector["bytes"])


@pytest.mark.parametrize(
    ("name", "kind", "values"),
    [
        ("quaternion_identity", 0x59, [32768, 0, 0, 0]),
        ("quaternion_quarter_turn", 0x59, [23170, 0, 23170, 0]),
        ("acceleration", 0x51, [0, 0, 2048, 2500]),
    ],
)
def test_witmotion(name, kind, values):
    assert witmotion_frame(kind, values) == octets(VECTORS["witmotion"][name]["bytes"])


def test_xbus():
    vector = VECTORS["xbus"]
    assert xbus_message(0x30) == octets(vector["go_to_config"]["bytes"])
    assert xbus_message(0x10) == octets(vector["go_to_measurement"]["bytes"])
    data = octets("10 20 02 00 07 10 60 04 00 01 e2 40 20 10 10 3f 80 00 00") + bytes(12)
    assert xbus_message(DATA, data) == octets(vector["data"]["bytes"])
