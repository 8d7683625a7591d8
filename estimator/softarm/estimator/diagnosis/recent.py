"""Answers that are asked for again: the latest are kept."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

Answer = TypeVar("Answer")


class Recent(Generic[Answer]):
    """The latest answers to some questions, by what was asked.

    Fits, searches and checks of what they found ask a model about the same effects of the same sizes many
    times over. Copies, in other processes too, begin empty: they are asked other questions.

    Args:
        most: Largest number of answers kept.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._answers: dict[Hashable, Answer] = {}

    def get(self, key: Hashable, answer: Callable[[], Answer]) -> Answer:
        """Return the answer kept for a key, or ask for it; it is shared, and so must not be written to."""
        kept = self._answers.pop(key, None)
        if kept is None:
            kept = answer()
            if len(self._answers) == self._most:
                del self._answers[next(iter(self._answers))]
        self._answers[key] = kept  # the last of all: the first is what nobody asked for the longest
        return kept

    def __reduce__(self) -> tuple[type["Recent[Answer]"], tuple[int]]:
        """Copy without the answers."""
        return Recent, (self._most,)
