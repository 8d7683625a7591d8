"""The tables of the proof."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from softarm.bench.proof.score import Score
from softarm.common.tables import Cell, Table

AIMS = {"single": 0.95, "pair": 0.85, "null": 0.01, "foreign": 0.90}
EXCITATIONS = ("designed", "ordinary")
ALIKE = "line_leak"
"""Not identifiable: a leak of the fake arm's short lines takes a share of a pressure, as a gain does."""
IDENTIFIABLE = "identifiable effects named and placed"


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """Give the 95 % interval of a share (Wilson, JASA 22, 1927)."""
    if trials == 0:
        return 0.0, 1.0
    z, share = 1.959964, hits / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def proof_tables(scores: Sequence[Score]) -> tuple[Table, ...]:
    """Arrange all scores: a summary, the effects one by one, and every failure."""
    return (summary(scores), by_effect(scores), improvement(scores), failures(scores))


def summary(scores: Sequence[Score]) -> Table:
    """Count how each kind of trial fared."""
    rows: list[dict[str, Cell]] = []
    for excitation in EXCITATIONS:
        for kind in AIMS:
            chosen = _of(scores, kind, excitation)
            if chosen:
                rows += [
                    _row(kind, excitation, what, hits, count) for what, hits, count in _counts(kind, chosen)
                ]
    return Table(
        "Sealed trials",
        rows,
        (
            "Named: a finding bears the concealed name. In the set: it bears it or lists it among what "
            "the data cannot tell from it. Interval: Wilson, 95 %.",
            "Designed: the manoeuvres that tell effects apart, in two mounts. Ordinary: random poses and "
            "ramps of the same arms. One that ended without a report named nothing.",
            "Identifiable: all but leaks, which in the fake arm's short lines are lost gains.",
        ),
    )


def _counts(kind: str, scores: Sequence[Score]) -> list[tuple[str, int, int]]:
    hits = [hit for score in scores for hit in score.hits]
    if kind == "null":
        return [("false alarms", sum(s.false_alarm for s in scores), len(scores))]
    if kind == "foreign":
        return [("called unknown", sum(s.called_unknown for s in scores), len(scores))]
    known = [hit for hit in hits if hit.effect != ALIKE]
    counts = [
        (IDENTIFIABLE, sum(hit.right for hit in known), len(known)),
        ("effects named and placed", sum(hit.right for hit in hits), len(hits)),
        ("effects in the set", sum(hit.in_set for hit in hits), len(hits)),
        ("trials with a surplus name", sum(bool(s.surplus) for s in scores), len(scores)),
    ]
    if kind == "pair":
        both = sum(all(hit.right for hit in s.hits) for s in scores)
        counts.insert(0, ("both named and placed", both, len(scores)))
    return counts


def _row(kind: str, excitation: str, what: str, hits: int, count: int) -> dict[str, Cell]:
    low, high = wilson(hits, count)
    aimed = what in ("false alarms", "called unknown", IDENTIFIABLE) and kind != "pair"
    aim = AIMS[kind] if aimed or what == "both named and placed" else None
    sign = "at most" if kind == "null" else "at least"
    return {
        "excitation": excitation,
        "trials": kind,
        "what": what,
        "count": hits,
        "of": count,
        "percent": 100.0 * hits / count if count else None,
        "interval_percent": f"{100 * low:.0f}-{100 * high:.0f}",
        "aim_percent": None if aim is None else f"{sign} {100 * aim:g}",
    }


def by_effect(scores: Sequence[Score]) -> Table:
    """Say of each effect how often it was found, where, how large, and what it was taken for."""
    rows: list[dict[str, Cell]] = []
    found = [
        (s.outcome.excitation, hit) for s in scores if s.outcome.trial.kind != "foreign" for hit in s.hits
    ]
    for name in sorted({hit.effect for _, hit in found}):
        row: dict[str, Cell] = {"effect": name}
        for excitation in EXCITATIONS:
            hits = [hit for where, hit in found if where == excitation and hit.effect == name]
            row[f"{excitation}_trials"] = len(hits)
            row[f"{excitation}_named"] = sum(hit.named for hit in hits)
            row[f"{excitation}_in_set"] = sum(hit.in_set for hit in hits)
            row[f"{excitation}_placed"] = sum(bool(hit.placed) for hit in hits)
        every = [hit for _, hit in found if hit.effect == name]
        errors = [100.0 * hit.error for hit in every if hit.error is not None]
        row["size_error_percent"] = float(np.median(errors)) if errors else None
        taken = Counter(hit.taken_for or "nothing" for hit in every if not hit.named)
        row["taken_for"] = ", ".join(f"{what} {count}" for what, count in taken.most_common()) or None
        rows.append(row)
    return Table(
        "Effects of single trials and pairs", rows, ("Size error: median, where both define the size alike.",)
    )


def improvement(scores: Sequence[Score]) -> Table:
    """Say how much better held-out data are predicted, by kind of trial."""
    rows: list[dict[str, Cell]] = []
    for excitation in EXCITATIONS:
        unchanged = [score.heldout[1] for score in _of(scores, "null", excitation) if score.ran]
        for kind in AIMS:
            parts = np.array([score.heldout for score in _of(scores, kind, excitation) if score.ran])
            if len(parts):
                after = float(np.median(parts[:, 1]))
                rows.append(
                    {
                        "excitation": excitation,
                        "trials": kind,
                        "heldout_before": float(np.median(parts[:, 0])),
                        "heldout_after": after,
                        "worst_after": float(parts[:, 1].max()),
                        "after_over_null": after / float(np.median(unchanged)) if unchanged else None,
                    }
                )
    return Table(
        "Mismatch on held-out data, in units of noise (medians)",
        rows,
        (
            "Aim: 1.2 times the floor. Noise alone is a floor for sensors; what the model leaves of arms in "
            "which nothing was concealed (null) is one for diagnoses, and the last column is over that.",
        ),
    )


def failures(scores: Sequence[Score]) -> Table:
    """List every trial in which something went wrong."""
    rows: list[dict[str, Cell]] = [
        {
            "trial": score.outcome.trial.name,
            "excitation": score.outcome.excitation,
            "concealed": ", ".join(hit.effect for hit in score.hits) or "nothing",
            "said": score.outcome.told or ", ".join(score.named) or str(score.outcome.report.get("verdict")),
            "status": score.outcome.status,
        }
        for score in scores
        if not _right(score)
    ]
    right = sum(map(_right, scores))
    return Table("Trials that went wrong", rows, (f"{right} of {len(scores)} diagnoses were right.",))


def _right(score: Score) -> bool:
    if not score.ran:
        return False
    kind = score.outcome.trial.kind
    if kind == "null":
        return not score.false_alarm
    if kind == "foreign":
        return score.called_unknown
    return all(hit.right for hit in score.hits) and not score.surplus


def _of(scores: Sequence[Score], kind: str, excitation: str) -> list[Score]:
    return [s for s in scores if s.outcome.trial.kind == kind and s.outcome.excitation == excitation]


def ran_table(scores: Sequence[Score]) -> Table:
    """Say how many diagnoses ended with a report, and how long they took."""
    rows: list[dict[str, Cell]] = []
    for excitation in EXCITATIONS:
        chosen = [s for s in scores if s.outcome.excitation == excitation]
        if chosen:
            seconds = np.array([s.outcome.seconds for s in chosen])
            rows.append(
                {
                    "excitation": excitation,
                    "diagnoses": len(chosen),
                    "with_report": sum(s.ran for s in chosen),
                    "recorded_s": float(np.median([s.outcome.recorded_s for s in chosen])),
                    "median_s": float(np.median(seconds)),
                    "longest_s": float(seconds.max()),
                }
            )
    return Table("Cost", rows, ("Aim: ten minutes of recording in five minutes on two cores.",))
