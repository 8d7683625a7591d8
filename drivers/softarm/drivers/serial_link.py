"""One serial port on the event loop: opened exclusively, read as bytes arrive, gone when the device is.

The port is read through its file descriptor. After a hang-up such a descriptor stays readable but
empty, which would spin the loop, so the reader is removed at the first empty read. Opening, which a USB
adapter may stretch to many milliseconds, happens in a worker thread.
"""

import asyncio
import contextlib
import errno
import os
import termios
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, Literal, TypeVar

import serial
from pydantic import Field

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.config import DriverConfig
from softarm.drivers.errors import ConnectionLost, DeviceError, ProtocolError
from softarm.drivers.supervisor import Timing

Result = TypeVar("Result")

MARGIN_S = 3.0
"""What the supervisor grants a device beyond its own deadline for the first frame [s]."""

_CHUNK = 4096
_CAUSES = {
    errno.ENOENT: ("does not exist", "plug it in; `ls /dev/serial/by-id` shows what is there"),
    errno.EACCES: (
        "may not be opened (no permission)",
        "add the user to the group of the port, often dialout",
    ),
    errno.EBUSY: ("is in use", "close the other program"),
    errno.EAGAIN: ("is in use", "close the other program"),
    errno.EWOULDBLOCK: ("is in use", "close the other program"),
}


Baud = Annotated[int, Field(ge=300, le=4_000_000)]
Latency = Annotated[float, Field(ge=0, le=1)]


class SerialConfig(DriverConfig):
    """Settings of an instrument on a serial line.

    Attributes:
        port: The device file; one below `/dev/serial/by-id` keeps its name when the device is plugged in
            again.
        baud: Speed [bit/s]; always eight data bits, one stop bit.
        parity: None, even or odd.
        dtr: `hold` keeps the control line as it is between connections, so that an Arduino starts anew only
            when it is plugged in; `reset` pulls it, so that an Arduino starts anew at each connection.
        latency_s: Time from the measurement to the last byte of its frame [s]: the instrument's and the
            line's.
        identify_s: Time for the first good frame [s]; an Arduino takes up to three seconds to boot.
    """

    port: Annotated[str, Field(min_length=1)]
    baud: Baud
    parity: Literal["N", "E", "O"] = "N"
    dtr: Literal["hold", "reset"] = "hold"
    latency_s: Latency = 0.0
    identify_s: Annotated[float, Field(gt=0, le=60)] = 5.0

    def address(self) -> str:
        """Return the address as a URL."""
        return f"serial://{self.port}?baud={self.baud}"

    @property
    def timing(self) -> Timing:
        """Deadlines of the supervisor."""
        return Timing(self.stale_after_s, self.lost_after_s, identify_s=self.identify_s + MARGIN_S)


class SerialLink:
    """An open port; `on_bytes` is called with each portion and its arrival [ns] until lost or closed."""

    def __init__(self, device: str, port: serial.Serial, clock: Clock = monotonic) -> None:
        self.device = device
        self.on_bytes: Callable[[bytes, int], None] = _drop
        self._port = port
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._lost: asyncio.Future[None] = self._loop.create_future()
        self._reading = True
        self._loop.add_reader(port.fileno(), self._on_readable)

    def write(self, data: bytes) -> None:
        """Send a command.

        Raises:
            ConnectionLost: The device is gone, or accepts no data.
        """
        try:
            sent = os.write(self._port.fileno(), data)
        except (OSError, serial.SerialException) as error:
            raise ConnectionLost(
                self.device, f"accepts no commands: {error}", "check cable and power"
            ) from error
        # The descriptor does not block, so a full buffer accepts a part and the device would read half a
        # command.
        if sent != len(data):
            raise ConnectionLost(self.device, "accepts no more commands", "check cable and power")

    def flush(self) -> None:
        """Drop bytes that have come and are not read yet."""
        with contextlib.suppress(OSError, termios.error):
            self._port.reset_input_buffer()

    def fail(self, error: DeviceError) -> None:
        """End the link with an error that `wait_lost` raises."""
        self._stop_reading()
        if not self._lost.done():
            self._lost.set_exception(error)

    async def while_open(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Do work on the link and return its result.

        Raises:
            DeviceError: The link was lost before the work was done; it is cancelled.
        """
        task = asyncio.ensure_future(work)
        try:
            either: set[asyncio.Future[Any]] = {task, self._lost}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if not task.done():
                self._lost.result()  # raises what ended the link
            return await task
        finally:
            task.cancel()
            await asyncio.wait({task})

    async def wait_lost(self) -> None:
        """Wait until the link is lost, and raise what ended it."""
        await asyncio.shield(self._lost)

    def close(self) -> None:
        """Release the port; what is not yet sent is dropped, or the kernel would wait for it."""
        self._stop_reading()
        if self._lost.done():
            self._lost.exception()  # counts as retrieved: nobody may have waited for it
        else:
            self._lost.cancel()
        with contextlib.suppress(OSError, termios.error, serial.SerialException):
            self._port.reset_output_buffer()
        with contextlib.suppress(OSError, termios.error):
            self._port.close()

    def _on_readable(self) -> None:
        try:
            data = os.read(self._port.fileno(), _CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            self._hang_up(str(error))
            return
        if not data:
            self._hang_up("end of file")
            return
        self.on_bytes(data, self._clock())

    def _hang_up(self, why: str) -> None:
        self.fail(ConnectionLost(self.device, f"was unplugged ({why})", "plug it in again"))

    def _stop_reading(self) -> None:
        if self._reading:
            self._reading = False
            self._loop.remove_reader(self._port.fileno())


async def open_serial(config: SerialConfig, clock: Clock = monotonic) -> SerialLink:
    """Open a port and drop what came before.

    Raises:
        ConnectionLost: The port is not there, in use, or may not be opened.
        ProtocolError: The port cannot run at this speed.
    """
    opening = asyncio.get_running_loop().run_in_executor(None, _open, config)
    try:
        port = await asyncio.shield(opening)  # a thread cannot be cancelled; its port must be closed later
    except asyncio.CancelledError:
        opening.add_done_callback(_close_unwanted)
        raise
    except (serial.SerialException, OSError, termios.error) as error:
        what, cure = _CAUSES.get(_error_number(error), (f"cannot be opened: {error}", "check cable and path"))
        raise ConnectionLost(config.name, f"{config.port} {what}", cure) from error
    except ValueError as error:
        raise ProtocolError(
            config.name, f"{config.port} cannot run at {config.baud} baud", "set baud"
        ) from error
    return SerialLink(config.name, port, clock)


def _open(config: SerialConfig) -> serial.Serial:
    port = serial.Serial(
        port=config.port,
        baudrate=config.baud,
        parity=config.parity,
        timeout=0,
        write_timeout=0,
        exclusive=True,
    )
    try:
        os.set_blocking(port.fileno(), False)
        if config.dtr == "hold":
            _keep_control_lines(port.fileno())
        else:
            _pull_dtr(port)
        # A USB adapter otherwise collects bytes for 16 ms; a pseudo-terminal has no such mode.
        with contextlib.suppress(OSError, ValueError):
            port.set_low_latency_mode(True)
        # Bytes from before have no time of arrival.
        port.reset_input_buffer()
    except BaseException:
        port.close()
        raise
    return port


def _keep_control_lines(descriptor: int) -> None:
    """Keep the lines when the port is closed: an edge at the next opening would reset an Arduino."""
    attributes = termios.tcgetattr(descriptor)
    attributes[2] &= ~termios.HUPCL
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def _pull_dtr(port: serial.Serial) -> None:
    """Drop and raise DTR; a pseudo-terminal has none."""
    with contextlib.suppress(OSError):
        port.dtr = False
        port.dtr = True


def _close_unwanted(opening: asyncio.Future[serial.Serial]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _error_number(error: BaseException) -> int:
    """Return the error number; pyserial's error for a port in use hides it in its cause."""
    for candidate in (error, error.__cause__, error.__context__):
        number = getattr(candidate, "errno", None)
        if number:
            return int(number)
    return 0


def _drop(data: bytes, arrival_ns: int) -> None:
    pass
