"""Whatever a host sends: the fakes answer or stay silent, they never fall over."""

from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.fakes.devices import DeviceSurroundings, build_instrument, catalogue
from softarm.fakes.faults import FaultBoard
from softarm.fakes.parts import PART_OF_KIND, SerialPart
from softarm.fakes.qtm.discovery import discovery_reply
from softarm.fakes.qtm.session import ClientSession
from softarm.fakes.scenario import check_scenario
from softarm.fakes.still import StillArm
from softarm.fakes.valves.modbus import LONGEST_PDU, execute
from tests.sim_fakes.test_qtm import Software
from tests.sim_fakes.test_valves import terminal

KINDS = sorted(kind for kind, part in PART_OF_KIND.items() if issubclass(part, SerialPart))
REGISTERS = st.sampled_from([40001, 40003, 40256, 45357, 45392, 45395, 46100, 0, 65535])
REQUESTS = st.builds(
    lambda code, address, rest: bytes([code]) + address.to_bytes(2, "big") + rest,
    st.sampled_from([3, 4, 6, 16, 23, 43]), REGISTERS, st.binary(max_size=40),
)  # fmt: skip


@settings(max_examples=150)
@given(st.one_of(st.binary(min_size=1, max_size=LONGEST_PDU), REQUESTS))
def test_modbus(pdu):
    answer = execute(terminal(), pdu)
    assert answer[0] == pdu[0] or (answer[0] == pdu[0] | 0x80 and answer[1] in (1, 2, 3))
    assert len(answer) <= LONGEST_PDU


WORDS = st.sampled_from(
    [
        "StreamFrames",
        "GetParameters",
        "Version",
        "UDP:6734",
        "6D",
        "All",
        "1.25",
        "Frequency:3",
        "stop",
        ":",
        "\0",
    ]
)


@settings(max_examples=150)
@given(st.one_of(st.text(max_size=60), st.lists(WORDS, max_size=5).map(" ".join)))
def test_qtm(command):
    reply = ClientSession(Software(), "192.0.2.1").answer(command)
    assert not reply or int.from_bytes(reply[:4], "little") == len(reply)


@given(st.binary(max_size=20))
def test_discovery(datagram):
    assert discovery_reply(datagram, 22222) is None or len(datagram) == 10


@settings(max_examples=120)
@given(
    st.sampled_from(KINDS),
    st.lists(
        st.one_of(st.binary(max_size=12), st.sampled_from([b"\r", b"?\r", b"9", b"\xff\xaa", b"\xfa\xff"])),
        max_size=8,
    ),
)
def test_serial_instruments(kind, portions):
    part = check_scenario({"device": [{"name": "it", "kind": kind}]}).device[0]
    arm = StillArm()
    instrument = build_instrument(part, DeviceSurroundings(arm, 1), FaultBoard("it", catalogue(part)))
    instrument.power_on(0.0)
    for portion in portions:
        assert len(instrument.receive(1.0, portion, arm.state)) < 4096
    due = instrument.next_time()
    assert due is None or instrument.update(due, arm.state) is not None
