"""The force estimate on a pull that no diagnosis has seen, without and with the physics it found."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from acceptance.proof.trial import FORCE_RUN, Folders
from softarm.analysis.offline.inputs import in_its_mount, load_recordings
from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import track
from softarm.bench.trials.outcome import TrialOutcome, read_outcomes
from softarm.bench.trials.run import WRITTEN
from softarm.common.tables import Cell, Table
from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import arrange, section_forces
from softarm.estimator.specimen import Specimen, load_specimen

RATE = 5.0
"""Estimates per second."""


def force_table(folders: Folders, notify: Callable[[str], None], largest: int) -> Table:
    """Estimate the pull of the gauge in trials with findings, on the specimen without and with them.

    Args:
        folders: Where the proof works; diagnosed trials whose pull was kept count.
        notify: Called with progress messages.
        largest: Number of trials at most.
    """
    chosen = [one for one in read_outcomes(folders.results) if _usable(one, folders)][:largest]
    rows: list[dict[str, Cell]] = []
    for number, one in enumerate(chosen, start=1):
        notify(f"force on {one.trial}, {number} of {len(chosen)}")
        rows.append(force_row(one, folders))
    ratios = [float(row["ratio"]) for row in rows if isinstance(row["ratio"], float)]
    median = f"Median ratio: {np.median(ratios):.3g}. " if ratios else ""
    note = (
        f"{median}Lateral forces on both sections at {RATE:g} per second while the gauge draws the tip; no "
        "diagnosis saw a pull. Before: calibrated on the nominal recordings."
    )
    return Table("Force on a held-out pull: rms error [N]", rows, (note,))


def force_row(one: TrialOutcome, folders: Folders) -> dict[str, Cell]:
    """Compare the errors of one trial."""
    specimen = load_specimen(folders.report(one.trial) / WRITTEN)
    pull = pulled(folders, one)
    before, span = force_error(specimen.model_copy(update={"physics": ()}), pull)
    after, _ = force_error(specimen, pull)
    return {
        "trial": one.trial,
        "found": ", ".join(finding["effect"] for finding in one.report["findings"]),
        "range_n": span,
        "before_n": before,
        "after_n": after,
        "ratio": after / before,
    }


def pulled(folders: Folders, one: TrialOutcome) -> Path:
    """Find the recording of the pull."""
    return next(_recordings(folders, one).glob(f"run_*{FORCE_RUN}*"))


def force_error(specimen: Specimen, recording: Path) -> tuple[float, float]:
    """Return the rms error of the estimated forces over a recording, and the range of the known ones [N]."""
    (loaded,) = load_recordings([recording])
    specimen = in_its_mount(specimen, loaded)
    model = build_arm(specimen)
    known = section_forces(specimen)
    run = resample(arrange(loaded, specimen, model.sections, known), RATE)
    found = track(model, specimen, run)
    order = [(load.section, load.direction) for load in known]
    wanted = run.loads[:, [order.index((load.section, load.direction)) for load in found.loads]]
    span = float(np.nanmax(wanted) - np.nanmin(wanted))
    return float(np.sqrt(np.nanmean((found.forces - wanted) ** 2))), span


def _usable(one: TrialOutcome, folders: Folders) -> bool:
    written = folders.report(one.trial) / WRITTEN
    kept = list(_recordings(folders, one).glob(f"run_*{FORCE_RUN}*"))
    named = any(finding["effect"] != "unknown" for finding in one.report.get("findings", []))
    return one.trial.endswith("_designed") and named and written.exists() and bool(kept)


def _recordings(folders: Folders, one: TrialOutcome) -> Path:
    """Return the folder of all recordings of the arm of a trial."""
    return folders.root / "recordings" / one.trial.rpartition("_")[0]
