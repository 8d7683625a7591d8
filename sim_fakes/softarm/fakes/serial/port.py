"""A pseudo-terminal behind a stable link, paced like the real line, that can be unplugged."""

import asyncio
import os
import pty
import select
import termios
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from softarm.fakes.clock import Clock
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.instrument import BITS_PER_BYTE, Instrument

CHUNK = 16
"""Bytes written at once: at 9600 baud they take 17 ms, as a USB adapter delivers them."""
IDLE = 0.02
"""How long the port sleeps at most [s]: a host that opens it is noticed by polling."""
HAIR = 1e-9
"""Rounding of times that are due [s]."""

SPEEDS = {
    number: getattr(termios, f"B{number}")
    for number in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600)
}


class SerialPort:
    """Puts an instrument on a pseudo-terminal.

    While no host has it open, bytes vanish as on a real line; a host that opens it starts with a clean one.

    Args:
        link: Path of the symbolic link to the terminal.
        state: Returns the latest snapshot of the arm.
        clock: The fakes' clock.
        seed: Seed of the line faults.
    """

    def __init__(
        self,
        instrument: Instrument,
        link: Path,
        state: Callable[[], PlantState],
        clock: Clock,
        seed: int,
    ) -> None:
        self.instrument = instrument
        self.link = link
        self.lost_bytes = 0
        self.plugs = 0
        self._state = state
        self._clock = clock
        self._random = np.random.default_rng(seed)
        self._controller: int | None = None
        self._open = False
        self._poll = select.poll()
        self._queue = bytearray()
        self._line_free = 0.0
        self._wake = asyncio.Event()
        instrument.faults.listen(self._on_fault)

    def plug(self) -> None:
        """Make the terminal, point the link at it and switch the instrument on."""
        controller, terminal = pty.openpty()
        tty.setraw(terminal)  # fresh ones echo, and would feed the instrument its own bytes
        os.set_blocking(controller, False)
        fresh = self.link.with_name(f".{self.link.name}.{os.getpid()}")
        fresh.symlink_to(os.ttyname(terminal))
        fresh.replace(self.link)  # at once: a host never finds the link half made
        # Ours would hide whether a host has the terminal open: only without one does the controller hang up.
        os.close(terminal)
        self._controller = controller
        self._poll.register(controller, select.POLLIN)
        self.plugs += 1
        self._queue += self.instrument.power_on(self._clock.now())
        self._wake.set()

    def unplug(self) -> None:
        """Remove the terminal and its link, with whatever was on the line."""
        if self._controller is None:
            return
        self._detach()
        controller, self._controller = self._controller, None
        self._poll.unregister(controller)
        self.link.unlink(missing_ok=True)
        os.close(controller)

    async def run(self) -> None:
        """Send the bytes of the instrument at the speed of the line, forever."""
        while True:
            now = self._clock.now()
            self._follow_host(now)
            due = self.instrument.next_time()
            if due is not None and due <= now + HAIR and not self._queue:
                self._enqueue(self.instrument.update(now, self._state()))
                continue
            if self._queue and self._line_free <= now + HAIR:
                self._send_chunk(now)
                continue
            await self._pause(min(now + IDLE, self._line_free if self._queue else due or now + IDLE))

    def _follow_host(self, now: float) -> None:
        """Notice that a host has opened or closed the terminal."""
        if self._controller is None:
            return
        hung_up = any(events & select.POLLHUP for _, events in self._poll.poll(0))
        # The reader is removed with the host: a controller that has hung up is readable for ever.
        if self._open and hung_up:
            self._detach()
        elif not self._open and not hung_up:
            self._open = True
            asyncio.get_running_loop().add_reader(self._controller, self._on_readable)
            if self.instrument.resets_on_open:
                self._queue += self.instrument.power_on(now)

    def _detach(self) -> None:
        """Leave the line to itself: no host listens."""
        if self._open and self._controller is not None:
            asyncio.get_running_loop().remove_reader(self._controller)
        self._open = False
        self._queue.clear()

    async def _pause(self, until: float) -> None:
        """Wait for a time, or for bytes to send."""
        self._wake.clear()
        try:
            async with asyncio.timeout(max(0.0, until - self._clock.now())):
                await self._wake.wait()
        except TimeoutError:
            return

    def _enqueue(self, data: bytes) -> None:
        """Queue the bytes of the instrument, with the faults of the line."""
        faults = self.instrument.faults
        if not self._open or not data:
            return
        if faults.hit("silence"):
            return
        if garbage := faults.hit("garbage"):
            data = self._random.bytes(int(garbage["size"])) + data
        if faults.hit("torn_frame"):
            data = data[: max(1, len(data) // 2)]
        if faults.active("byte_loss"):
            data = self._lose_bytes(data)
        if faults.active("bit_flip"):
            data = self._flip_bits(data)
        # A pseudo-terminal carries bytes at any speed: a wrong one must be shown on purpose.
        if self.instrument.checks_baud and self._host_baud() != self.instrument.baud:
            data = self._garble(data)
        self._queue += data
        self._wake.set()

    def _lose_bytes(self, data: bytes) -> bytes:
        loss = self.instrument.faults.active("byte_loss")
        kept = self._random.random(len(data)) >= (float(loss["per_byte"]) if loss else 0.0)
        if not kept.all():
            self.instrument.faults.hit("byte_loss")
        return bytes(np.frombuffer(data, np.uint8)[kept])

    def _flip_bits(self, data: bytes) -> bytes:
        flip = self.instrument.faults.active("bit_flip")
        struck = self._random.random(len(data)) < (float(flip["per_byte"]) if flip else 0.0)
        if struck.any():
            self.instrument.faults.hit("bit_flip")
        masks = np.where(struck, 1 << self._random.integers(0, 8, len(data)), 0).astype(np.uint8)
        return bytes(np.frombuffer(data, np.uint8) ^ masks)

    def _garble(self, data: bytes) -> bytes:
        """Show what a receiver at another speed sees: about as many bytes as its clock ticks."""
        share = self._host_baud() / self.instrument.baud
        return self._random.bytes(max(1, round(len(data) * min(4.0, share))))

    def _host_baud(self) -> int:
        """Read the speed that the host has set on the terminal [bit/s]; 0 for one not in the table."""
        if self._controller is None:
            return 0
        speed = termios.tcgetattr(self._controller)[5]
        return next((number for number, code in SPEEDS.items() if code == speed), 0)

    def _send_chunk(self, now: float) -> None:
        """Put the next bytes on the line and keep it busy for as long as they take."""
        if stall := self.instrument.faults.hit("stall"):
            self._line_free = now + float(stall["seconds"])
            return
        chunk = bytes(self._queue[:CHUNK])
        del self._queue[:CHUNK]
        # A little lateness is made up for, so that the mean rate is that of the line.
        late = now - self._line_free
        start = self._line_free if late < IDLE else now
        self._line_free = start + len(chunk) * BITS_PER_BYTE / self.instrument.baud
        if self._controller is not None and self._open:
            self._write(self._controller, chunk)

    def _write(self, controller: int, chunk: bytes) -> None:
        try:
            written = os.write(controller, chunk)
        except (BlockingIOError, InterruptedError):
            written = 0  # the host does not read: bytes are lost, as in a receiver that overruns
        except OSError:
            self._detach()
            return
        self.lost_bytes += len(chunk) - written

    def _on_readable(self) -> None:
        """Pass bytes of the host to the instrument."""
        if self._controller is None:
            return
        try:
            data = os.read(self._controller, 4096)
        except BlockingIOError:
            return
        except OSError:
            self._detach()
            return
        if self.instrument.checks_baud and self._host_baud() != self.instrument.baud:
            data = self._garble(data)
        self._enqueue(self.instrument.receive(self._clock.now(), data, self._state()))

    def _on_fault(self, name: str, active: bool) -> None:
        if name != "unplug":
            return
        if active:
            self.instrument.faults.hit(name)
            self.unplug()
        elif self._controller is None:
            self.plug()
