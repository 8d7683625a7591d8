"""Scores diagnoses against the concealed effects. Only this module opens the answers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from softarm.bench.trials.folders import Answer, Concealment
from softarm.bench.trials.outcome import TrialOutcome

PLACES = ("segment", "chamber", "section", "sensor")
DEVIATIONS = 2.0


@dataclass(frozen=True)
class Counterpart:
    """What the size in an answer is called in a report.

    Args:
        parameters: Of the estimator; of several, the components of a vector, the size is the length.
        offset: What the answer's has more than the estimator's.
    """

    parameters: tuple[str, ...]
    offset: float = 0.0


COUNTERPARTS = {
    ("base_tilt", "angle"): Counterpart(("tilt_x", "tilt_y")),
    ("base_tilt", "tilt"): Counterpart(("tilt_x", "tilt_y")),
    ("chamber_gain", "change"): Counterpart(("gain",)),
    ("distributed_mass", "share"): Counterpart(("change",)),
    ("external_force", "force"): Counterpart(("force_x", "force_y", "force_z")),
    ("frame_misalignment", "angle"): Counterpart(("yaw",)),
    ("line_lag", "time"): Counterpart(("lag",)),
    ("pressure_saturation", "limit"): Counterpart(("ceiling",)),
    ("segment_stiffness", "factor"): Counterpart(("change",), 1.0),
    ("sensor_bias", "angle"): Counterpart(("bias_x", "bias_y")),
    ("sensor_bias", "bias"): Counterpart(("bias_x", "bias_y")),
    ("sensor_drift", "rate"): Counterpart(("rate_x", "rate_y")),
    ("sensor_scale", "change"): Counterpart(("scale",)),
    ("thermal_drift", "share"): Counterpart(("change",)),
    ("valve_deadband", "width"): Counterpart(("band",)),
}
"""Sizes that an answer may call otherwise than the estimator does."""


@dataclass(frozen=True)
class SizeHit:
    """The size of a named effect; conventions of sign may differ.

    Args:
        parameter: Its name.
        true: As concealed.
        stated: In the report.
        deviation: Its standard deviation, as stated.
    """

    parameter: str
    true: float
    stated: float
    deviation: float

    @property
    def deviations(self) -> float:
        """By how many stated deviations it is off."""
        return (self.stated - self.true) / max(self.deviation, 1e-300)


@dataclass(frozen=True)
class Hit:
    """How one concealed effect fared.

    Args:
        effect: Its name.
        named: Whether a finding bears its name.
        in_set: Whether a finding names it or lists it among what the data cannot distinguish from it.
        placed: Whether that finding is at its place; ``None`` where it was not named.
        size: Its size; ``None`` where it was not placed or is defined otherwise.
        taken_for: What was named instead; empty where it was named or nothing was.
        over_limit: Its size over the detection limit that the report states for its place; ``None`` where
            that is of something else.
    """

    effect: str
    named: bool
    in_set: bool
    placed: bool | None
    size: SizeHit | None
    taken_for: str
    over_limit: float | None

    @property
    def error(self) -> float | None:
        """Relative error of its size."""
        return None if self.size is None else abs(self.size.stated - self.size.true) / self.size.true

    @property
    def inside(self) -> bool | None:
        """Whether the truth lies within two stated deviations of its size."""
        return None if self.size is None else abs(self.size.deviations) <= DEVIATIONS

    @property
    def right(self) -> bool:
        """Whether it was named at its place."""
        return self.named and bool(self.placed)


@dataclass(frozen=True)
class Score:
    """How one diagnosis fared.

    Args:
        outcome: Outcome of the diagnosis.
        answer: What was concealed.
        hits: One for each concealed effect.
        named: Names of all findings.
        surplus: Findings beyond the concealed effects.
        claims: For each named finding with a stated probability, that and whether it is right.
    """

    outcome: TrialOutcome
    answer: Answer
    hits: tuple[Hit, ...]
    named: tuple[str, ...]
    surplus: tuple[str, ...]
    claims: tuple[tuple[float, bool], ...]

    @property
    def ran(self) -> bool:
        """Whether there is a report."""
        return bool(self.outcome.report)

    @property
    def false_alarm(self) -> bool:
        """Whether something was named though nothing was concealed."""
        return self.answer.kind == "null" and bool(self.named)

    @property
    def called_unknown(self) -> bool:
        """Whether a mismatch was reported without a name of physics; an event only states when."""
        mismatch = self.ran and self.outcome.report["verdict"] != "consistent"
        return mismatch and not {*self.named} - {"event"}

    @property
    def right(self) -> bool:
        """Whether everything was named at its place, and nothing else."""
        if not self.ran:
            return False
        if self.answer.kind == "null":
            return not self.false_alarm
        if self.answer.kind == "foreign":
            return self.called_unknown
        return all(hit.right for hit in self.hits) and not self.surplus

    @property
    def heldout(self) -> tuple[float, float]:
        """Normalised rms on held-out data before and after."""
        part = self.outcome.report["heldout"]
        return float(part["normalised_rms_before"]), float(part["normalised_rms_after"])


def score(outcome: TrialOutcome, answer: Answer) -> Score:
    """Compare the outcome of a trial with its answer."""
    findings = [f for f in outcome.report.get("findings", []) if f["effect"] != "unknown"]
    limits = outcome.report.get("detection_limits", [])
    foreign = answer.kind == "foreign"
    hits = () if foreign else tuple(_hit(one, findings, limits) for one in answer.concealed)
    concealed = {one.effect for one in answer.concealed}
    surplus = tuple(
        f["effect"]
        for f in findings
        if not concealed & {f["effect"], *(r["effect"] for r in f["confusable_with"])}
    )
    claims = tuple(
        (float(f["probability"]), any(_is(one, f) for one in answer.concealed))
        for f in findings
        if f.get("probability") is not None
    )
    return Score(outcome, answer, hits, tuple(f["effect"] for f in findings), surplus, claims)


def _is(one: Concealment, finding: Mapping[str, Any]) -> bool:
    return one.effect == finding["effect"] and _placed(one.where, finding["where"])


def _hit(one: Concealment, findings: Sequence[Mapping[str, Any]], limits: Sequence[Mapping[str, Any]]) -> Hit:
    over_limit = _over_limit(one, limits)
    same = [finding for finding in findings if finding["effect"] == one.effect]
    rivals = {rival["effect"] for finding in findings for rival in finding["confusable_with"]}
    if not same:
        instead = findings[0]["effect"] if findings else ""
        return Hit(one.effect, False, one.effect in rivals, None, None, instead, over_limit)
    best = max(same, key=lambda finding: _placed(one.where, finding["where"]))
    placed = _placed(one.where, best["where"])
    return Hit(one.effect, True, True, placed, _size(one, best) if placed else None, "", over_limit)


def _placed(wanted: Mapping[str, Any], stated: Mapping[str, Any]) -> bool:
    """Return whether a place is the right one; a direction in the cross-section is not compared."""
    return all(str(wanted[kind]) == str(stated.get(kind)) for kind in PLACES if wanted.get(kind) is not None)


def _counterpart(effect: str, name: str) -> Counterpart:
    """Return what the size in an answer is called in a report."""
    return COUNTERPARTS.get((effect, name), Counterpart((name,)))


def _size(one: Concealment, finding: Mapping[str, Any]) -> SizeHit | None:
    """Compare the first size that both define."""
    for name, value in one.size.items():
        counterpart = _counterpart(one.effect, name)
        if not value or not all(own in finding["parameters"] for own in counterpart.parameters):
            continue
        stated = [finding["parameters"][own] for own in counterpart.parameters]
        length = math.hypot(*(float(own["value"]) for own in stated))
        # Of a length only the deviation along the vector counts.
        along = math.hypot(*(float(own["value"]) * float(own["std"]) for own in stated)) / max(length, 1e-300)
        return SizeHit(name, abs(value - counterpart.offset), length, along)
    return None


def _over_limit(one: Concealment, limits: Sequence[Mapping[str, Any]]) -> float | None:
    """Compare the concealed size with the limit of the same parameter at the same place."""
    sizes = {}
    for name, value in one.size.items():
        counterpart = _counterpart(one.effect, name)
        if len(counterpart.parameters) == 1:
            sizes[counterpart.parameters[0]] = value - counterpart.offset
    for limit in limits:
        there = all(one.where.get(kind) == limit["where"].get(kind) for kind in PLACES)
        if limit["effect"] == one.effect and there and limit["parameter"] in sizes:
            return abs(sizes[limit["parameter"]]) / float(limit["size"])
    return None
