"""Registers over Modbus TCP: pymodbus, with the answers checked that it lets through."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.errors import ConnectionLost, ProtocolError
from softarm.drivers.health import Health
from softarm.drivers.valves.link import ModbusExceptionError, NoAnswer

READ = 3
WRITE_ONE = 6
WRITE = 16
EXCHANGE = 23

CURE = "check address, cable and power of the terminal"

# It logs every time-out; the supervisor reports them once.
logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)


class ModbusTcpLink:
    """One Modbus TCP connection without retries and without reconnection: both are the supervisor's.

    pymodbus accepts short register lists and answers of another function, leaves a request pending
    until its time-out when the connection drops, and returns exception replies: all three end here as errors.

    Args:
        device: The device, as the configuration names it.
        host: Address of the terminal.
        port: TCP port.
        unit: Modbus unit.
        timeout_s: Time for one answer [s].
        open_s: Time to open the connection [s].
        health: Counters to keep.
        clock: Host monotonic time.
    """

    def __init__(
        self,
        device: str,
        host: str,
        port: int,
        *,
        unit: int,
        timeout_s: float,
        open_s: float,
        health: Health,
        clock: Clock = monotonic,
    ) -> None:
        self._device = device
        self._peer = f"{host}:{port}"
        self._unit = unit
        self._timeout_s = timeout_s
        self._health = health
        self._clock = clock
        self._pending = False
        self._client = AsyncModbusTcpClient(
            host, port=port, timeout=open_s, retries=0, reconnect_delay=0, trace_connect=self._on_connection
        )

    async def open(self) -> None:
        """Open the connection."""
        if not await self._client.connect():
            raise ConnectionLost(self._device, f"does not accept a connection at {self._peer}", CURE)
        # pymodbus has one time-out for opening and for answers; answers must come much sooner.
        self._client.ctx.comm_params.timeout_connect = self._timeout_s

    @property
    def connected(self) -> bool:
        """Whether the connection stands."""
        return self._client.connected

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """Read registers (function 3)."""
        answer = await self._request(
            lambda: self._client.read_holding_registers(address, count=count, device_id=self._unit),
            READ,
            address,
        )
        return self._registers(answer, count)

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Write registers (function 16)."""
        answer = await self._request(
            lambda: self._client.write_registers(address, list(words), device_id=self._unit), WRITE, address
        )
        if (answer.address, answer.count) != (address, len(words)):
            raise self._misfit(f"confirms {answer.count} words at {answer.address} instead of those written")

    async def write_one(self, address: int, word: int) -> None:
        """Write one register (function 6)."""
        answer = await self._request(
            lambda: self._client.write_register(address, word, device_id=self._unit), WRITE_ONE, address
        )
        if answer.address != address:
            raise self._misfit(f"confirms register {answer.address} instead of {address}")

    async def exchange(
        self, read_address: int, read_count: int, write_address: int, words: Sequence[int]
    ) -> tuple[int, ...]:
        """Write, then read, in one request (function 23)."""
        answer = await self._request(
            lambda: self._client.readwrite_registers(
                read_address=read_address,
                read_count=read_count,
                write_address=write_address,
                values=list(words),
                device_id=self._unit,
            ),
            EXCHANGE,
            write_address,
        )
        return self._registers(answer, read_count)

    def close(self) -> None:
        """Release the connection."""
        self._client.close()

    async def _request(
        self, request: Callable[[], Awaitable[ModbusPDU]], function: int, address: int
    ) -> ModbusPDU:
        # `request` is a function because pymodbus raises at the call, not at the await, when it has no
        # transport.
        began_ns = self._clock()
        self._pending = True
        task = asyncio.current_task()
        cancelled = task.cancelling() if task else 0
        try:
            answer = await request()
            if task and task.cancelling() > cancelled:
                # Before Python 3.12 `wait_for`, under pymodbus, loses a cancellation that meets the answer.
                raise asyncio.CancelledError
        # A write that timed out may still be carried out later: `NoAnswer` leaves the outputs unknown.
        except ModbusException as error:
            if not self._client.connected:
                raise ConnectionLost(self._device, "dropped the connection", CURE) from error
            self._health.timeouts += 1
            raise NoAnswer(self._device, "did not answer", CURE, limit=self._timeout_s, unit="s") from error
        finally:
            self._pending = False
        self._health.round_trip.add(self._clock() - began_ns)
        if answer.isError():
            raise ModbusExceptionError(self._device, function, answer.exception_code, address)
        if answer.function_code != function:
            raise self._misfit(f"answers function {answer.function_code} to function {function}")
        return answer

    def _registers(self, answer: ModbusPDU, count: int) -> tuple[int, ...]:
        if len(answer.registers) != count:
            raise self._misfit(f"answers {len(answer.registers)} registers instead of {count}")
        return tuple(answer.registers)

    def _misfit(self, what: str) -> ProtocolError:
        self._health.rejected += 1
        return ProtocolError(self._device, what, "check kind and firmware of the terminal")

    def _on_connection(self, connected: bool) -> None:
        if connected or not self._pending:
            return
        # Its request would wait for the whole time-out of a connection that is gone.
        pending: asyncio.Future[ModbusPDU] = self._client.ctx.response_future
        if not pending.done():
            pending.set_exception(ConnectionLost(self._device, "dropped the connection", CURE))
