"""The tables of scored trials."""

import itertools
from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

from softarm.bench.trials.score import Score
from softarm.common.tables import Cell, Table

KINDS = ("single", "pair", "null", "foreign")
AIMS = {
    "designed": {"single": 0.95, "pair": 0.85, "null": 0.01, "foreign": 0.90},
    "ordinary": {"single": 0.85, "pair": 0.60, "null": 0.01, "foreign": 0.80},
}
"""Shares that are aimed at, by the kind of motion and of trial."""
MOST_SURPLUS = 0.02
"""Share of trials with a surplus name that is aimed at."""
TEN_MINUTES = 600.0
"""Length of recordings for which the cost is stated [s]."""
ALIKE = "line_leak"
"""Not identifiable: a leak of the fake arm's short lines scales a pressure, as a gain does."""
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.01)
OVER_LIMIT = (0.0, 0.5, 1.0, 2.0, np.inf)
IDENTIFIABLE = "identifiable effects named and placed"
BOTH = "both named and placed"
SURPLUS = "trials with a surplus name"


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson, JASA 22, 1927)."""
    if trials == 0:
        return 0.0, 1.0
    interval = binomtest(hits, trials).proportion_ci(0.95, "wilson")
    return float(interval.low), float(interval.high)


def score_tables(scores: Sequence[Score]) -> tuple[Table, ...]:
    """Arrange all scores: a summary, the effects one by one, and every failure."""
    return (
        summary(scores),
        by_effect(scores),
        sizes(scores),
        improvement(scores),
        reliability(scores),
        limits(scores),
        failures(scores),
        cost(scores),
    )


def summary(scores: Sequence[Score]) -> Table:
    """Count how each kind of trial fared."""
    rows: list[dict[str, Cell]] = []
    for motion in motions(scores):
        for kind in KINDS:
            chosen = _of(scores, kind, motion)
            if chosen:
                rows += [_row(kind, motion, what, hits, count) for what, hits, count in _counts(kind, chosen)]
    return Table(
        "Blind trials",
        rows,
        (
            "Named: a finding has the concealed name. In the set: it has it or lists it among what "
            "the data cannot distinguish from it. Interval: Wilson, 95 %.",
            "Motion: as the answers say; designed runs are manoeuvres that distinguish effects. A trial that "
            "ended without a report named nothing. Identifiable: all but leaks, which in short lines are "
            "lost gains.",
        ),
    )


def _counts(kind: str, scores: Sequence[Score]) -> list[tuple[str, int, int]]:
    hits = [hit for score in scores for hit in score.hits]
    if kind == "null":
        return [("false alarms", sum(s.false_alarm for s in scores), len(scores))]
    if kind == "foreign":
        return [("called unknown", sum(s.called_unknown for s in scores), len(scores))]
    identifiable = [hit for hit in hits if hit.effect != ALIKE]
    counts = [
        (IDENTIFIABLE, sum(hit.right for hit in identifiable), len(identifiable)),
        ("effects named and placed", sum(hit.right for hit in hits), len(hits)),
        ("effects in the set", sum(hit.in_set for hit in hits), len(hits)),
        (SURPLUS, sum(bool(s.surplus) for s in scores), len(scores)),
    ]
    if kind == "pair":
        both = sum(all(hit.right for hit in s.hits) for s in scores)
        counts.insert(0, (BOTH, both, len(scores)))
    return counts


def _row(kind: str, motion: str, what: str, hits: int, count: int) -> dict[str, Cell]:
    low, high = wilson(hits, count)
    return {
        "motion": motion,
        "trials": kind,
        "what": what,
        "count": hits,
        "of": count,
        "percent": 100.0 * hits / count if count else None,
        "interval_percent": f"{100 * low:.0f}-{100 * high:.0f}",
        "aim_percent": _aim(kind, motion, what),
    }


def _aim(kind: str, motion: str, what: str) -> str | None:
    """Put what is aimed at into words; ``None`` where nothing is."""
    if what == SURPLUS:
        return f"at most {100 * MOST_SURPLUS:g}"
    of_kind = what == BOTH if kind == "pair" else what in ("false alarms", "called unknown", IDENTIFIABLE)
    if not of_kind or motion not in AIMS:
        return None
    return f"{'at most' if kind == 'null' else 'at least'} {100 * AIMS[motion][kind]:g}"


def by_effect(scores: Sequence[Score]) -> Table:
    """Tabulate for each effect how often it was named, where, how large, and what was named instead."""
    rows: list[dict[str, Cell]] = []
    pairs = [(s.answer.motion, hit) for s in scores if s.answer.kind != "foreign" for hit in s.hits]
    for name in sorted({hit.effect for _, hit in pairs}):
        row: dict[str, Cell] = {"effect": name}
        for motion in motions(scores):
            hits = [hit for where, hit in pairs if where == motion and hit.effect == name]
            row[f"{motion or 'all'}_trials"] = len(hits)
            row[f"{motion or 'all'}_named"] = sum(hit.named for hit in hits)
            row[f"{motion or 'all'}_in_set"] = sum(hit.in_set for hit in hits)
            row[f"{motion or 'all'}_placed"] = sum(bool(hit.placed) for hit in hits)
        every = [hit for _, hit in pairs if hit.effect == name]
        errors = [100.0 * hit.error for hit in every if hit.error is not None]
        inside = [hit.inside for hit in every if hit.inside is not None]
        row["size_inside_2_std"] = f"{sum(inside)} of {len(inside)}" if inside else None
        row["size_error_percent"] = float(np.median(errors)) if errors else None
        taken = Counter(hit.taken_for or "nothing" for hit in every if not hit.named)
        row["taken_for"] = ", ".join(f"{what} {count}" for what, count in taken.most_common()) or None
        rows.append(row)
    return Table(
        "Effects of single trials and pairs", rows, ("Size error: median, where both define the size alike.",)
    )


def sizes(scores: Sequence[Score]) -> Table:
    """Compare the sizes of named effects with the truth."""
    sizes = [(s.outcome.trial, hit, hit.size) for s in scores for hit in s.hits if hit.size is not None]
    rows: list[dict[str, Cell]] = [
        {
            "trial": trial,
            "effect": hit.effect,
            "parameter": size.parameter,
            "true": size.true,
            "found": size.stated,
            "deviation": size.deviation,
            "deviations_off": size.deviations,
        }
        for trial, hit, size in sizes
    ]
    errors = [hit.error for _, hit, _ in sizes if hit.error is not None]
    inside = sum(bool(hit.inside) for _, hit, _ in sizes)
    words = f"{inside} of {len(sizes)} within two stated deviations (aim 90 %)"
    if errors:
        words += f"; median error {100.0 * float(np.median(errors)):.1f} % (aim at most 10 %)"
    return Table("Sizes", rows, (f"{words}.",))


def improvement(scores: Sequence[Score]) -> Table:
    """Tabulate how much better held-out data are predicted, by kind of trial."""
    rows: list[dict[str, Cell]] = []
    for motion in motions(scores):
        unchanged = [score.heldout[1] for score in _of(scores, "null", motion) if score.ran]
        for kind in KINDS:
            parts = np.array([score.heldout for score in _of(scores, kind, motion) if score.ran])
            if len(parts):
                after = float(np.median(parts[:, 1]))
                rows.append(
                    {
                        "motion": motion,
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


def limits(scores: Sequence[Score]) -> Table:
    """Compare the detection limits that reports state with which effects are named."""
    sized = [(hit.over_limit, hit.right) for s in scores for hit in s.hits if hit.over_limit is not None]
    rows: list[dict[str, Cell]] = []
    for low, high in itertools.pairwise(OVER_LIMIT):
        named = [right for size, right in sized if low <= size < high]
        if named:
            rows.append(
                {
                    "size_over_limit": f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more",
                    "effects": len(named),
                    "named_and_placed": sum(named),
                    "percent": 100.0 * float(np.mean(named)),
                }
            )
    return Table(
        "Detection limits against what was found",
        rows,
        (
            "At its limit an effect should be found in nine of ten recordings. A limit is that of the effect "
            "alone, also in a pair.",
        ),
    )


def failures(scores: Sequence[Score]) -> Table:
    """List every trial in which something went wrong."""
    rows: list[dict[str, Cell]] = [
        {
            "trial": score.outcome.trial,
            "motion": score.answer.motion,
            "concealed": ", ".join(one.effect for one in score.answer.concealed) or "nothing",
            "said": score.outcome.message
            or ", ".join(score.named)
            or str(score.outcome.report.get("verdict")),
            "missed, size over limit": ", ".join(
                f"{hit.effect} {hit.over_limit:.2g}"
                for hit in score.hits
                if hit.over_limit is not None and not hit.right
            )
            or None,
            "status": score.outcome.status,
        }
        for score in scores
        if not score.right
    ]
    right = sum(score.right for score in scores)
    limit = (
        "Limit: from which the report itself says that the effect is found there in nine of ten such "
        "recordings; below 1 the effect is smaller."
    )
    return Table("Trials that went wrong", rows, (f"{right} of {len(scores)} diagnoses were right.", limit))


def motions(scores: Sequence[Score]) -> list[str]:
    """List the kinds of motion in the answers."""
    return sorted({score.answer.motion for score in scores})


def reliability(scores: Sequence[Score]) -> Table:
    """Compare the probabilities that findings state with how often they are right."""
    claims = [claim for score in scores for claim in score.claims]
    rows: list[dict[str, Cell]] = []
    for low, high in itertools.pairwise(BINS):
        chosen = [(p, right) for p, right in claims if low <= p < high]
        if chosen:
            rows.append(
                {
                    "stated_percent": f"{100 * low:g} to {min(100 * high, 100):g}",
                    "names": len(chosen),
                    "mean_stated_percent": 100.0 * float(np.mean([p for p, _ in chosen])),
                    "right_percent": 100.0 * float(np.mean([right for _, right in chosen])),
                }
            )
    return Table(
        "Stated probability against truth", rows, ("Names without a stated probability are left out.",)
    )


def _of(scores: Sequence[Score], kind: str, motion: str) -> list[Score]:
    return [s for s in scores if s.answer.kind == kind and s.answer.motion == motion]


def cost(scores: Sequence[Score]) -> Table:
    """Count the diagnoses that ended with a report, and time them."""
    rows: list[dict[str, Cell]] = []
    for motion in motions(scores):
        chosen = [s for s in scores if s.answer.motion == motion]
        if chosen:
            seconds = np.array([s.outcome.seconds for s in chosen])
            core = np.array([s.outcome.core_s for s in chosen])
            recorded = np.array([s.outcome.recorded_s for s in chosen])
            of_ten_minutes = TEN_MINUTES / np.maximum(recorded, 1.0)
            rows.append(
                {
                    "motion": motion,
                    "diagnoses": len(chosen),
                    "with_report": sum(s.ran for s in chosen),
                    "recorded_s": float(np.median(recorded)),
                    "median_s": float(np.median(seconds)),
                    "longest_s": float(seconds.max()),
                    "median_s_for_ten_minutes": float(np.median(of_ten_minutes * seconds)),
                    "median_core_s_for_ten_minutes": float(np.median(of_ten_minutes * core)),
                }
            )
    return Table(
        "Cost", rows, ("Aim: ten minutes of recording in 30 s of one core. Other diagnoses ran beside each.",)
    )
