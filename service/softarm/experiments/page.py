"""The page of the experiments, from the tables that a campaign printed."""

from collections.abc import Sequence

from softarm.common.tables import Table, as_markdown

HEAD = """# The paper's experiments

Printed by `softarm experiment all --fake --seeds {seeds} --write docs/experiments.md`. Cangan et al. measured
on a SoPrA arm; the figures here come from simulated arms whose physics differs from the estimator's
([fake-arm.md](fake-arm.md)). The column `aim met` shows which aims were missed.

The unknowns of the calibration were chosen on arms 1 and 2 ([calibration.md](calibration.md)). If a
covariance is right, 90 to 98 % of the errors lie within two standard deviations; the column `inside 2
std` shows the measured percentage. In the row `moving` the gauge's stage moves slowly; in `swinging` it
displaces the section at 20 mm/s and releases it; the time after the release, when no force acts, counts too.
Pulls on the intermediate section are judged with a
calibration that used pulls on the tip only. In teach mode a simulated hand moves the vented arm to
random poses; the table counts all of them, and separately those that pressures can reach.

"""


def experiments_page(tables: Sequence[Table], seeds: int) -> str:
    """Write the page."""
    return HEAD.format(seeds=seeds) + as_markdown(*(table for table in tables if table.rows)) + "\n"
