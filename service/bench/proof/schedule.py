"""Which sealed trials there are: kinds in fixed shares, every effect in turn."""

import re
import subprocess
import sys
from dataclasses import dataclass

import numpy as np

from service.errors import WorkFailedError

PATTERN = (
    *("single", "null", "single", "single", "pair", "single", "null", "single", "foreign", "single"),
    *("null", "single", "pair", "single", "null", "single", "single", "pair", "null", "foreign"),
)
"""Kinds of twenty trials: ten single effects, five without any, three pairs, two foreign."""

FOREIGN = " (foreign)"


@dataclass(frozen=True)
class SealedTrial:
    """One trial.

    Args:
        kind: ``null``, ``single``, ``pair`` or ``foreign``.
        seed: Draws the arm, the place, the size and the noise.
        only: Effects to draw from, joined by plus signs; all of the kind when empty.
    """

    kind: str
    seed: int
    only: str = ""

    @property
    def name(self) -> str:
        """Name of its folders; it does not tell the effect."""
        return f"{self.kind}_{self.seed}"


def schedule(count: int, seed: int, effects: tuple[str, ...], foreign: tuple[str, ...]) -> list[SealedTrial]:
    """List the trials of a proof.

    Args:
        count: How many.
        seed: Of the first; the others count upwards, and the order of the effects is drawn from it.
        effects: Names of the vocabulary that single trials go through.
        foreign: Names outside it that foreign trials go through.
    """
    rng = np.random.default_rng(seed)
    turns = {"single": rng.permutation(effects).tolist(), "foreign": rng.permutation(foreign).tolist()}
    used = dict.fromkeys(turns, 0)
    trials = []
    for number in range(count):
        kind, only = PATTERN[number % len(PATTERN)], ""
        if kind in turns:
            only = turns[kind][used[kind] % len(turns[kind])]
            used[kind] += 1
        trials.append(SealedTrial(kind, seed + number, only))
    return trials


def known_effects() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ask the fake arm for its effects: those of the vocabulary, and the foreign ones.

    Raises:
        WorkFailedError: It does not answer.
    """
    done = subprocess.run(
        [sys.executable, "-m", "sim_fakes.plant", "effects"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise WorkFailedError(f"the fake arm lists no effects: {done.stderr.strip()[-200:]}")
    names = [
        match.group(1).strip() for line in done.stdout.splitlines() if (match := re.match(r"(.+?) +\[", line))
    ]
    own = tuple(name for name in names if not name.endswith(FOREIGN))
    return own, tuple(name.removesuffix(FOREIGN) for name in names if name.endswith(FOREIGN))
