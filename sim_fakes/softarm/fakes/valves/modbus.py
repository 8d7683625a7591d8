"""Modbus application protocol as a CPX node serves it: function codes 3, 6, 16, 23 and 43."""

import struct
from collections.abc import Sequence

from softarm.fakes.valves.node import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, CpxNode, ModbusError

MBAP = struct.Struct(">HHHB")
LONGEST_PDU = 253
MOST_READ, MOST_WRITTEN, MOST_EXCHANGED = 125, 123, 121
IDENTITY = {0: b"Festo", 1: b"CPX-FB36", 2: b"fake"}


def execute(registers: CpxNode, pdu: bytes) -> bytes:
    """Serve one request.

    Returns:
        The answering PDU; an exception response when the request cannot be served.
    """
    handlers = {3: _read, 6: _write_one, 16: _write_many, 23: _exchange, 43: _identify}
    code = pdu[0]
    try:
        return handlers.get(code, _refuse)(registers, pdu)
    except struct.error:
        return bytes([code | 0x80, ILLEGAL_VALUE])
    except ModbusError as error:
        return bytes([code | 0x80, error.code])


def _refuse(_registers: CpxNode, _pdu: bytes) -> bytes:
    raise ModbusError(ILLEGAL_FUNCTION)


def _words(values: Sequence[int]) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


def _read(registers: CpxNode, pdu: bytes) -> bytes:
    address, count = struct.unpack(">HH", pdu[1:])
    _check(1 <= count <= MOST_READ)
    return bytes([3, 2 * count]) + _words(registers.read(address, count))


def _write_one(registers: CpxNode, pdu: bytes) -> bytes:
    address, value = struct.unpack(">HH", pdu[1:])
    registers.write(address, [value])
    return pdu


def _write_many(registers: CpxNode, pdu: bytes) -> bytes:
    address, count, size = struct.unpack(">HHB", pdu[1:6])
    _check(1 <= count <= MOST_WRITTEN and size == 2 * count)
    registers.write(address, struct.unpack(f">{count}H", pdu[6:]))
    return pdu[:5]


def _exchange(registers: CpxNode, pdu: bytes) -> bytes:
    read_address, read_count, address, count, size = struct.unpack(">HHHHB", pdu[1:10])
    _check(1 <= read_count <= MOST_READ and 1 <= count <= MOST_EXCHANGED and size == 2 * count)
    registers.write(address, struct.unpack(f">{count}H", pdu[10:]))  # the write comes before the read
    return bytes([23, 2 * read_count]) + _words(registers.read(read_address, read_count))


def _identify(_registers: CpxNode, pdu: bytes) -> bytes:
    """Read device identification (MEI type 14), basic objects, by stream (1) or one of them (4)."""
    kind, access, first = struct.unpack(">BBB", pdu[1:])
    _check(kind == 14 and access in (1, 4))
    if first not in IDENTITY:
        raise ModbusError(ILLEGAL_ADDRESS)
    objects = {first: IDENTITY[first]} if access == 4 else {k: v for k, v in IDENTITY.items() if k >= first}
    body = b"".join(bytes([number, len(text)]) + text for number, text in objects.items())
    return bytes([43, 14, access, 1, 0, 0, len(objects)]) + body


def _check(legal: bool) -> None:
    if not legal:
        raise ModbusError(ILLEGAL_VALUE)
