"""Recording while the arm runs: a file that survives a loss of power, written by a thread of its own."""

import queue
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from service.recordings.files import refuse_existing
from service.recordings.mcap_writer import Stamp, Stream, StreamWriter

PART = ".part"
LONGEST_QUEUE = 20_000


class Recorder:
    """Writes streams to an MCAP file without ever blocking the caller.

    The file is called ``<name>.mcap.part`` until it is closed. Messages wait in a bounded queue;
    those that find it full are dropped and counted.

    Args:
        path: Final place, ending in ``.mcap``.
        streams: What will be written.
        attachments: File name to contents: ``recording.toml``, ``specimen.toml``, ``config.toml``.
        longest_queue: Messages that may wait.

    Raises:
        InputError: The path or its ``.part`` exists.
    """

    def __init__(
        self,
        path: Path,
        streams: Iterable[Stream],
        *,
        attachments: Mapping[str, bytes] | None = None,
        longest_queue: int = LONGEST_QUEUE,
    ) -> None:
        self.path = path
        self.part = path.with_name(path.name + PART)
        for taken in (self.path, self.part):
            refuse_existing(taken, force=False)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.part.open("xb")
        self._writer = StreamWriter(self._file, streams, attachments=attachments)
        self._queue: queue.Queue[Callable[[], None] | None] = queue.Queue(longest_queue)
        self._dropped = 0
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="recorder")
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Messages lost because the disk did not keep up."""
        return self._dropped

    @property
    def failure(self) -> OSError | None:
        """What stopped the writing, such as a full disk."""
        return self._failure

    def write(self, topic: str, values: Sequence[float], stamp: Stamp) -> None:
        """Queue one message of an announced stream; NaN stands for a lost reading."""
        self._put(lambda: self._writer.write(topic, values, stamp))

    def write_document(self, topic: str, document: Mapping[str, Any], stamp: Stamp) -> None:
        """Queue a message of another kind, such as a change of mode."""
        self._put(lambda: self._writer.write_document(topic, document, stamp))

    def close(self) -> Path:
        """Write what waits, finish the file and give it its name.

        Raises:
            OSError: The disk refused; the part file keeps what it holds.
        """
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        if self._failure is not None:
            self._file.close()
            raise self._failure
        if not self._file.closed:
            self._writer.finish()
            self._file.close()
            self.part.rename(self.path)
        return self.path

    def __enter__(self) -> "Recorder":
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file, whatever happened."""
        self.close()

    def _put(self, job: Callable[[], None]) -> None:
        try:
            self._queue.put_nowait(job)
        except queue.Full:
            self._dropped += 1

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            if self._failure is not None:
                self._dropped += 1
                continue
            try:
                job()
            except OSError as error:
                self._failure = error
