"""The planned pressures of an excitation over time."""

from pathlib import Path

import numpy as np

from softarm.analysis.plots.figures import KPA_PER_PA, label, save, stacked
from softarm.estimator.excitation import ExcitationPlan


def plot_plan(plan: ExcitationPlan, path: Path) -> Path:
    """Draw the set-points of each manoeuvre, one panel a manoeuvre."""
    figure, panels = stacked(max(1, len(plan.choices)), share=False)
    for panel, choice in zip(panels, plan.choices, strict=False):
        manoeuvre = choice.manoeuvre
        for chamber, column in enumerate(manoeuvre.pressures.T):
            if np.any(column > 0.0):
                panel.plot(manoeuvre.times, KPA_PER_PA * column, linewidth=0.9, label=f"chamber {chamber}")
        panel.set_xlabel("s", fontsize=8)
        label(panel, f"{manoeuvre.name}: {manoeuvre.by_hand or manoeuvre.shows}", "kPa")
    path.parent.mkdir(parents=True, exist_ok=True)
    return save(figure, path)
