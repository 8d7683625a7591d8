"""What the valve bank needs of a Modbus connection; any transport that implements it will do."""

from collections.abc import Sequence
from typing import Protocol

from softarm.drivers.errors import ConnectionLost, DeviceError

BUSY = 6
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledge",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not respond",
}


class NoAnswer(ConnectionLost):
    """A request without an answer in time; a write may or may not have been carried out."""


class ModbusExceptionError(DeviceError):
    """A Modbus exception reply.

    Args:
        device: The device, as the configuration names it.
        function: Function code of the request.
        code: Exception code.
        address: First register of the request.
    """

    retried = False  # the same request meets the same refusal; only `busy` passes

    def __init__(self, device: str, function: int, code: int, address: int) -> None:
        meaning = EXCEPTIONS.get(code, "unknown exception")
        what = f"refuses function {function} at register {address} with exception {code}, {meaning}"
        super().__init__(device, what, "check kind, address and unit of the terminal")
        self.code = code

    @property
    def busy(self) -> bool:
        """Whether the same request may succeed a moment later."""
        return self.code == BUSY


class RegisterLink(Protocol):
    """Holding registers at the other end of a connection.

    Every method raises `NoAnswer` after the time-out, `ConnectionLost` at once when the connection breaks,
    `ModbusExceptionError` on an exception reply and `ProtocolError` on an answer that does not fit its
    request.
    """

    @property
    def connected(self) -> bool:
        """Whether the connection stands."""

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """Read registers (function 3)."""

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Write registers (function 16)."""

    async def write_one(self, address: int, word: int) -> None:
        """Write one register (function 6)."""

    async def exchange(
        self, read_address: int, read_count: int, write_address: int, words: Sequence[int]
    ) -> tuple[int, ...]:
        """Write, then read, in one request (function 23)."""

    def close(self) -> None:
        """Release the connection."""
