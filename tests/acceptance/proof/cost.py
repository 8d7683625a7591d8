"""What a diagnosis costs against the length of what it is given, and against the effects that it tries."""

from collections.abc import Callable

from acceptance.proof.schedule import SealedTrial
from acceptance.proof.trial import Folders, lay_out, record
from softarm.bench.trials.run import diagnose_trial
from softarm.common.tables import Cell, Table
from softarm.estimator.effects import EFFECTS

COUNTS = (2, 4, 8, 12)
"""Numbers of suspect runs that are diagnosed together."""
SHARES = (2, 4, 8)
"""Every so-manieth effect alone is tried on the most runs."""


def cost_table(trial: SealedTrial, folders: Folders, notify: Callable[[str], None]) -> Table:
    """Time diagnoses of more and more runs of one trial, then of fewer and fewer effects, each on one core.

    Args:
        trial: Which one.
        folders: Where the proof works.
        notify: Called with progress messages.
    """
    notify("cost: recording")
    record(trial, folders)
    tried = [(count, tuple(EFFECTS)) for count in COUNTS]
    tried += [(COUNTS[-1], tuple(EFFECTS)[::share]) for share in SHARES]
    rows: list[dict[str, Cell]] = []
    for count, effects in tried:
        notify(f"cost: diagnosing {count} runs, {len(effects)} effects")
        laid_out = lay_out(trial, f"first {count}", folders)
        extra = [word for name in effects for word in ("--effect", name)]
        outcome = diagnose_trial(laid_out, folders.report(laid_out.name), extra)
        rows.append(
            {
                "runs": count,
                "recorded_s": outcome.recorded_s,
                "effects": len(effects),
                "took_s": outcome.seconds,
                "took_over_recorded": outcome.seconds / outcome.recorded_s,
                "with_report": bool(outcome.report),
            }
        )
    note = "One process each, the nominal runs included in the length. Effects: kinds, each at every place."
    return Table("Cost against length and effects", rows, (note,))
