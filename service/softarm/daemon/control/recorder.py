"""The recorder: one writer thread for each recording, behind a bounded queue."""

import logging
import queue
import shutil
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from google.protobuf.message import Message

from softarm.daemon.safety.checks import RESERVE_BYTES
from softarm.daemon.safety.observation import RecorderHealth
from softarm.recordings.info import format_info
from softarm.recordings.mcap_writer import INFO_FILE, STARTED, RecordTimes, Start, StreamWriter, Topic

logger = logging.getLogger(__name__)

QUEUE_LENGTH = 8192
SPACE_CHECK_S = 1.0
"""Time between two checks of the free space of the disk [s]."""
OPEN_S = 5.0
CLOSE_S = 10.0
PART_SUFFIX = ".part"


class RecorderError(Exception):
    """A recording that cannot be started or ended."""


@dataclass(frozen=True)
class Sample:
    """One message of a stream of numbers."""

    topic: Topic
    values: tuple[float, ...]
    stamp: RecordTimes


@dataclass(frozen=True)
class Document:
    """One message of another kind: a change of mode, a command."""

    topic: str
    content: Mapping[str, Any]
    stamp: RecordTimes


@dataclass(frozen=True)
class Drawing:
    """One message of Foxglove's schemas, made in the writer's thread.

    Args:
        topic: Topic of the message.
        draw: Makes the message from the wall clock at its time [ns].
        stamp: When it was measured.
    """

    topic: str
    draw: Callable[[int], Message]
    stamp: RecordTimes


Item = Sample | Document | Drawing | None


@dataclass
class _Run:
    """One recording, from the request to start it until its thread ends.

    Args:
        name: File name without suffix.
        attachments: Files kept in it.
        info: Facts of the run.
        start: Clocks at its time zero.
    """

    name: str
    attachments: Mapping[str, bytes]
    info: Mapping[str, Any]
    start: Start
    queue: "queue.SimpleQueue[Item]" = field(default_factory=queue.SimpleQueue)
    opened: "Future[Path]" = field(default_factory=Future)
    ended: "Future[None]" = field(default_factory=Future)
    path: Path | None = None
    dropped: int = 0
    error: str = ""
    abandoned: bool = False


def _create(path: Path) -> IO[bytes]:
    return path.open("xb")


def _free_space(directory: Path) -> int:
    return shutil.disk_usage(directory).free


def _clocks() -> Start:
    return Start(time.monotonic_ns(), time.time_ns())


class Recorder:
    """Writes the streams to MCAP files in a directory.

    Opening, writing and closing are done in a thread, so that a disk that does not answer holds up a command
    no longer than stated. A file is named ``.part`` until it is closed; a torn one opens up to its last
    second.

    Args:
        directory: Where the files go; it is made when missing.
        create: Creates a file and opens it for writing.
        free_bytes: Returns the space left at the last look, without looking; ``None`` when unknown.
        header: Entries of every recording: arm, specimen, configuration, version, host.
        find_free_space: Looks up the free space of a directory's disk [bytes].
        clocks: Reads both clocks of the host.
    """

    def __init__(
        self,
        directory: Path,
        create: Callable[[Path], IO[bytes]] = _create,
        free_bytes: Callable[[], int | None] = lambda: None,
        *,
        header: Mapping[str, Any] | None = None,
        find_free_space: Callable[[Path], int] = _free_space,
        clocks: Callable[[], Start] = _clocks,
    ) -> None:
        self._directory = directory
        self._create = create
        self._free_bytes = free_bytes
        self._header = dict(header or {})
        self._find_free_space = find_free_space
        self._clocks = clocks
        self._lock = threading.Lock()
        self._run: _Run | None = None
        self._dropped, self._error = 0, ""
        self.closing = False

    @property
    def path(self) -> Path | None:
        """The file being written, under its final name."""
        run = self._run
        return None if run is None or run.error else run.path

    @property
    def start_clocks(self) -> Start | None:
        """Both clocks at time zero of the recording that is open."""
        run = self._run
        return None if run is None or run.path is None or run.error else run.start

    def health(self) -> RecorderHealth:
        """Return the state of the recorder for the health checks."""
        run = self._run
        dropped = self._dropped if run is None else run.dropped
        return RecorderHealth(self.path is not None, dropped, self._error, self._free_bytes())

    def start(
        self, name: str, attachments: Mapping[str, bytes], info: Mapping[str, Any] | None = None
    ) -> Path:
        """Open a file; this waits for the disk, so the event loop calls it in a thread.

        Args:
            name: File name without suffix; a number is added when it is in use.
            attachments: Files kept in it: specimen and configuration.
            info: Facts of this run: who started it, the time of the session.

        Returns:
            The file's final path.

        Raises:
            RecorderError: A file is open already, or the directory cannot be written or does not answer.
        """
        clocks = self._clocks()
        run = _Run(name, attachments, self._header | _clock_info(clocks) | dict(info or {}), clocks)
        with self._lock:
            if self._run is not None:
                raise RecorderError(f"{self._run.path or self._run.name} is being recorded; stop it first")
            self._run, self._dropped, self._error, self.closing = run, 0, "", False
        # A daemon: the process must be able to end while the disk hangs.
        thread = threading.Thread(target=self._record, args=(run,), name="softarm-recorder", daemon=True)
        thread.start()
        try:
            return run.opened.result(OPEN_S)
        except TimeoutError:
            # The writer may still be waiting for the disk; it removes its file when it sees this.
            run.abandoned = True
            raise RecorderError(f"{self._directory}: the disk did not answer within {OPEN_S:g} s") from None

    def put(self, item: Sample | Document | Drawing) -> None:
        """Queue a message; when the disk cannot keep up it is dropped and counted."""
        # Without the lock: the loop never waits here, and a message just after the end may be lost.
        run = self._run
        if run is None or run.path is None or run.error or self.closing:
            return
        if run.queue.qsize() < QUEUE_LENGTH:
            run.queue.put(item)
        else:
            run.dropped += 1

    def stop(self) -> tuple[Path, int]:
        """Close the file; this waits for the disk, so the event loop calls it in a thread.

        Returns:
            The file and how many messages were dropped.

        Raises:
            RecorderError: Nothing is being recorded, writing had failed, or the disk does not answer.
        """
        with self._lock:
            run = self._run
            if run is None or run.path is None:
                raise RecorderError(self._error or "nothing is being recorded")
            if self.closing:
                raise RecorderError(f"{run.path} is being closed")
            self.closing = True
        run.queue.put(None)
        try:
            run.ended.result(CLOSE_S)
        except TimeoutError:
            raise RecorderError(
                f"{run.path} is still being closed: the disk did not answer within {CLOSE_S:g} s; "
                f"what was written is in {run.path.name}{PART_SUFFIX}"
            ) from None
        if run.error:
            raise RecorderError(run.error)
        return run.path, run.dropped

    def _record(self, run: _Run) -> None:
        """Record one run; the writer thread, whose every error becomes that of the recording."""
        try:
            self._write(run)
        except Exception as error:
            run.error = self._failure(run, error)
            if not isinstance(error, RecorderError):
                logger.exception("the recording %s failed", run.name)
            if not run.opened.done():
                run.opened.set_exception(RecorderError(run.error))
        with self._lock:
            self._run, self._dropped, self._error = None, run.dropped, run.error
            self.closing = False
        run.ended.set_result(None)

    def _failure(self, run: _Run, error: Exception) -> str:
        if isinstance(error, RecorderError):
            return str(error)
        reason = error.strerror if isinstance(error, OSError) and error.strerror else repr(error)
        if run.path is None:
            return f"{self._directory}: {reason}"
        return f"{run.path.name}: {reason}; what was written is in {run.path.name}{PART_SUFFIX}"

    def _write(self, run: _Run) -> None:
        self._directory.mkdir(parents=True, exist_ok=True)
        free_bytes = self._find_free_space(self._directory)
        if free_bytes < RESERVE_BYTES:
            raise RecorderError(f"{self._directory}: {_disk_full(free_bytes)}")
        path = _free_path(self._directory, run.name)
        part = path.with_name(path.name + PART_SUFFIX)
        with self._create(part) as file:
            if run.abandoned:
                part.unlink(missing_ok=True)
                raise RecorderError(f"{path.name}: was opened too late and abandoned")
            writer = StreamWriter(
                file,
                attachments={**run.attachments, INFO_FILE: format_info(run.info)},
                start=run.start,
                metadata={key: str(value) for key, value in run.info.items()},
            )
            run.path = path
            run.opened.set_result(path)
            ended_by_itself = self._write_items(writer, run)
            writer.finish()
        # Only a file that is whole has the final name.
        part.rename(path)
        if ended_by_itself:
            raise RecorderError(f"{path.name} was ended: {ended_by_itself}; it is complete up to there")

    def _write_items(self, writer: StreamWriter, run: _Run) -> str:
        """Write until the recording is stopped, or return why it ends by itself."""
        added: set[str] = set()
        checked_s = time.monotonic()
        while True:
            try:
                item = run.queue.get(timeout=SPACE_CHECK_S)
            except queue.Empty:
                pass
            else:
                if item is None:
                    return ""
                _write_item(writer, item, added)
            # By time, not by message: a disk that fills up while no sensor sends must end the recording too.
            if time.monotonic() - checked_s > SPACE_CHECK_S:
                checked_s, free_bytes = time.monotonic(), self._find_free_space(self._directory)
                if free_bytes < RESERVE_BYTES:
                    return _disk_full(free_bytes)


def _disk_full(free_bytes: int) -> str:
    return f"{free_bytes / 1e6:.0f} MB are left on its disk, of which {RESERVE_BYTES / 1e6:.0f} MB stay free"


def _clock_info(start: Start) -> dict[str, Any]:
    began = datetime.fromtimestamp(start.unix_ns * 1e-9, UTC)
    return {
        "started": began.isoformat(timespec="milliseconds"),
        STARTED: start.unix_ns,
        "unix_minus_monotonic_ns": start.unix_minus_monotonic_ns,
    }


def _write_item(writer: StreamWriter, item: Sample | Document | Drawing, added: set[str]) -> None:
    if isinstance(item, Drawing):
        writer.write_message(item.topic, item.draw(writer.unix_ns(item.stamp)), item.stamp)
        return
    if isinstance(item, Document):
        writer.write_document(item.topic, item.content, item.stamp)
        return
    if item.topic.name not in added:
        writer.add_topic(item.topic)
        added.add(item.topic.name)
    writer.write(item.topic.name, item.values, item.stamp)


def _free_path(directory: Path, name: str) -> Path:
    """Return the first path that is not in use; the directory is listed once."""
    taken = {entry.name.removesuffix(PART_SUFFIX) for entry in directory.iterdir()}
    numbered = (f"{name}-{number}.mcap" for number in range(2, len(taken) + 3))
    return directory / next(file for file in (f"{name}.mcap", *numbered) if file not in taken)
