"""The recorder: a writer thread behind a bounded queue, with a visible count of what it dropped."""

import queue
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from softarm.daemon.safety.observation import Recorder as RecorderHealth
from softarm.recordings.mcap_writer import Stamp, Stream, StreamWriter

QUEUE_LENGTH = 8192
PART_SUFFIX = ".part"


class RecorderError(Exception):
    """A recording that cannot be started or ended."""


@dataclass(frozen=True)
class Sample:
    """One message of a stream of numbers."""

    stream: Stream
    values: tuple[float, ...]
    stamp: Stamp


@dataclass(frozen=True)
class Document:
    """One message of another kind: a change of mode, a command."""

    topic: str
    content: Mapping[str, Any]
    stamp: Stamp


Item = Sample | Document | None


def _create(path: Path) -> IO[bytes]:
    return path.open("xb")


class Recorder:
    """Writes the streams to MCAP files in a directory.

    A file is named ``.part`` until it is closed; a torn one opens up to its last second.

    Args:
        directory: Where the files go; it is made when missing.
        create: Creates a file and opens it for writing.
        free_bytes: Returns the space left at the last look, without looking; ``None`` when unknown.
    """

    def __init__(
        self,
        directory: Path,
        create: Callable[[Path], IO[bytes]] = _create,
        free_bytes: Callable[[], int | None] = lambda: None,
    ) -> None:
        self._directory = directory
        self._create = create
        self._queue: queue.Queue[Item] = queue.Queue(QUEUE_LENGTH)
        self._thread: threading.Thread | None = None
        self._path: Path | None = None
        self._dropped = 0
        self._error = ""
        self.closing = False
        self._free_bytes = free_bytes

    @property
    def path(self) -> Path | None:
        """The file being written, under its final name."""
        return self._path

    def health(self) -> RecorderHealth:
        """Picture the recorder for the health checks."""
        return RecorderHealth(self._thread is not None, self._dropped, self._error, self._free_bytes())

    def start(self, name: str, attachments: Mapping[str, bytes]) -> Path:
        """Open a file.

        Args:
            name: File name without suffix; a number is added when it is taken.
            attachments: Files kept in it: specimen and configuration.

        Returns:
            The file's final path.

        Raises:
            RecorderError: A file is open already, or the directory cannot be written.
        """
        if self._thread is not None:
            raise RecorderError(f"{self._path} is being recorded; stop it first")
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            path = _free_path(self._directory, name)
            file = self._create(path.with_name(path.name + PART_SUFFIX))
        except OSError as error:
            raise RecorderError(f"{self._directory}: {error.strerror}") from error
        self._queue = queue.Queue(QUEUE_LENGTH)
        self._path, self._dropped, self._error = path, 0, ""
        writer = StreamWriter(file, attachments=attachments)
        self._thread = threading.Thread(
            target=self._write, args=(writer, file, path), name="softarm-recorder", daemon=True
        )
        self._thread.start()
        return path

    def put(self, item: Sample | Document) -> None:
        """Take a message; when the disk cannot keep up it is dropped and counted."""
        if self._thread is None:
            return
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self._dropped += 1

    def stop(self) -> tuple[Path, int]:
        """Close the file; this waits for the disk, so the event loop calls it in a thread.

        Returns:
            The file and how many messages were dropped.

        Raises:
            RecorderError: Nothing is being recorded, or writing had failed.
        """
        if self._thread is None or self._path is None:
            raise RecorderError("nothing is being recorded")
        if self.closing:
            raise RecorderError(f"{self._path} is being closed")
        self.closing = True
        self._queue.put(None)
        self._thread.join()
        path, self._thread, self._path, self.closing = self._path, None, None, False
        if self._error:
            raise RecorderError(self._error)
        return path, self._dropped

    def _write(self, writer: StreamWriter, file: IO[bytes], path: Path) -> None:
        known: set[str] = set()
        item: Item = None
        try:
            with file:
                while (item := self._queue.get()) is not None:
                    _write_item(writer, item, known)
                writer.finish()
            path.with_name(path.name + PART_SUFFIX).rename(path)
        except OSError as error:
            self._error = f"{path.name}: {error.strerror}; what was written is in {path.name}{PART_SUFFIX}"
            while item is not None:
                self._dropped += 1
                item = self._queue.get()


def _write_item(writer: StreamWriter, item: Sample | Document, known: set[str]) -> None:
    if isinstance(item, Document):
        writer.write_document(item.topic, item.content, item.stamp)
        return
    if item.stream.topic not in known:
        writer.add_stream(item.stream)
        known.add(item.stream.topic)
    writer.write(item.stream.topic, item.values, item.stamp)


def _free_path(directory: Path, name: str) -> Path:
    candidates: Sequence[str] = [name, *(f"{name}-{number}" for number in range(2, 10_000))]
    for candidate in candidates:
        path = directory / f"{candidate}.mcap"
        if not path.exists() and not path.with_name(path.name + PART_SUFFIX).exists():
            return path
    raise RecorderError(f"{directory}: too many recordings named {name}")
