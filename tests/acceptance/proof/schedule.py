"""Which sealed trials there are: kinds in fixed shares, effects, places and sizes drawn by their seeds."""

from dataclasses import dataclass

PATTERN = (
    *("single", "null", "single", "single", "pair", "single", "null", "single", "foreign", "single"),
    *("null", "single", "pair", "single", "null", "single", "single", "pair", "null", "foreign"),
)
"""Kinds of twenty trials: ten single effects, five without any, three pairs, two foreign."""


@dataclass(frozen=True)
class SealedTrial:
    """One trial.

    Args:
        kind: ``null``, ``single``, ``pair`` or ``foreign``.
        seed: Draws the arm, the place, the size and the noise.
        only: Effects to draw from, joined by plus signs; all of the kind when empty.
        specimen: Drawing of its arm, which is what the diagnosis is given: a shipped specimen or a file.
    """

    kind: str
    seed: int
    only: str = ""
    specimen: str = "sopra"

    @property
    def name(self) -> str:
        """Name of its folders; it does not tell the effect."""
        return f"{self.kind}_{self.seed}"


def schedule(count: int, seed: int, specimen: str = "sopra") -> list[SealedTrial]:
    """List the trials of a proof; more trials begin with the same ones.

    Args:
        count: How many.
        seed: Of the first of each kind; the others count upwards.
        specimen: Drawing of the arms.
    """
    used = dict.fromkeys(PATTERN, 0)
    trials = []
    for number in range(count):
        kind = PATTERN[number % len(PATTERN)]
        trials.append(SealedTrial(kind, seed + used[kind], specimen=specimen))
        used[kind] += 1
    return trials
