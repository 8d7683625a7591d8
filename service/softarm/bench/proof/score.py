"""Scoring: what the tool said beside what was concealed. Only this opens the answers."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softarm.bench.proof.trial import Folders, Outcome
from softarm.estimator.errors import InputError

PLACES = ("segment", "chamber", "section", "sensor")
SAME = {
    "base_compliance": ("compliance", "compliance"),
    "chamber_crosstalk": ("share", "share"),
    "chamber_gain": ("change", "gain"),
    "distributed_mass": ("change", "change"),
    "frame_misalignment": ("yaw", "yaw"),
    "line_lag": ("time", "lag"),
    "pressure_bias": ("bias", "bias"),
    "segment_stiffness": ("change", "change"),
    "sensor_latency": ("delay", "delay"),
    "sensor_scale": ("change", "scale"),
    "thermal_drift": ("change", "change"),
    "tip_payload": ("mass", "mass"),
    "valve_deadband": ("width", "band"),
    "viscoelastic_creep": ("strength", "strength"),
}
"""Parameters that the fake arm and the estimator define alike: the fake's name, the estimator's."""


@dataclass(frozen=True)
class Hit:
    """How one concealed effect fared.

    Args:
        effect: Its name.
        named: Whether a finding bears its name.
        in_set: Whether a finding bears it or lists it among what the data cannot tell from it.
        placed: Whether that finding is at its place; ``None`` where it was not named.
        error: Relative error of its size; ``None`` where it was not named or is defined otherwise.
        taken_for: What was named instead; empty where it was named or nothing was.
    """

    effect: str
    named: bool
    in_set: bool
    placed: bool | None
    error: float | None
    taken_for: str

    @property
    def right(self) -> bool:
        """Whether it was named at its place."""
        return self.named and bool(self.placed)


@dataclass(frozen=True)
class Score:
    """How one diagnosis fared.

    Args:
        outcome: What the tool gave.
        hits: One for each concealed effect.
        named: Names of all findings.
        surplus: Findings beyond the concealed effects.
    """

    outcome: Outcome
    hits: tuple[Hit, ...]
    named: tuple[str, ...]
    surplus: tuple[str, ...]

    @property
    def ran(self) -> bool:
        """Whether there is a report."""
        return bool(self.outcome.report)

    @property
    def false_alarm(self) -> bool:
        """Whether something was named though nothing was concealed."""
        return self.outcome.trial.kind == "null" and bool(self.named)

    @property
    def called_unknown(self) -> bool:
        """Whether a mismatch was reported without giving it a name."""
        return self.ran and self.outcome.report["verdict"] != "consistent" and not self.named

    @property
    def heldout(self) -> tuple[float, float]:
        """Normalised rms on held-out data before and after."""
        part = self.outcome.report["heldout"]
        return float(part["normalised_rms_before"]), float(part["normalised_rms_after"])


def score(outcome: Outcome, folders: Folders) -> Score:
    """Open the answer of a trial and compare.

    Raises:
        InputError: The answer is missing.
    """
    findings = [f for f in outcome.report.get("findings", []) if f["effect"] != "unknown"]
    effects = answer(folders.answer(outcome.trial))
    hits = tuple(_hit(effect, findings) for effect in effects)
    concealed = {effect["effect"] for effect in effects}
    names = tuple(finding["effect"] for finding in findings)
    surplus = tuple(
        f["effect"]
        for f in findings
        if not concealed & {f["effect"], *(r["effect"] for r in f["confusable_with"])}
    )
    return Score(outcome, hits, names, surplus)


def answer(folder: Path) -> list[dict[str, Any]]:
    """Read what was concealed in the suspect runs of a trial."""
    files = sorted(folder.glob("run_*/truth.toml"))
    if not files:
        raise InputError(str(folder), "holds no answer", "record the trial again")
    effects: list[dict[str, Any]] = tomllib.loads(files[0].read_text())["effects"]
    return effects


def _hit(effect: dict[str, Any], findings: Sequence[dict[str, Any]]) -> Hit:
    name = effect["effect"]
    same = [finding for finding in findings if finding["effect"] == name]
    rivals = {rival["effect"] for finding in findings for rival in finding["confusable_with"]}
    if not same:
        instead = findings[0]["effect"] if findings else ""
        return Hit(name, False, name in rivals, None, None, instead)
    best = max(same, key=lambda finding: _placed(effect["where"], finding["where"]))
    placed = _placed(effect["where"], best["where"])
    return Hit(name, True, True, placed, _error(effect, best) if placed else None, "")


def _placed(wanted: dict[str, Any], found: dict[str, Any]) -> bool:
    """Tell whether a place is the right one; a direction in the cross-section is not compared."""
    return all(str(wanted[kind]) == str(found.get(kind)) for kind in PLACES if wanted.get(kind) is not None)


def _error(effect: dict[str, Any], finding: dict[str, Any]) -> float | None:
    """Give the relative error of the size where both define it alike; conventions of sign may differ."""
    ours, theirs = SAME.get(effect["effect"], ("", ""))
    if ours not in effect["parameters"] or theirs not in finding["parameters"]:
        return None
    true = abs(float(effect["parameters"][ours]["value"]))
    found = abs(float(finding["parameters"][theirs]["value"]))
    return abs(found - true) / true if true > 0.0 else None
