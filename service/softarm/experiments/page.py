"""The page of the experiments, from the tables that a campaign printed."""

from collections.abc import Sequence

from softarm.common.tables import Table, as_markdown

HEAD = """# The paper's experiments

Printed by `softarm experiment all --fake --seeds {seeds} --write docs/experiments.md`. Cangan et al. measured
on a SoPrA arm; these figures are of fake arms, whose physics is not the estimator's
([fake-arm.md](fake-arm.md)). An aim that is missed says so in the column `aim met`.

What a calibration fits was chosen on arms 1 and 2 ([calibration.md](calibration.md)). Covariances: 90 to 98 %
of errors should lie inside two standard deviations; the column `inside 2 std` says where they do not. The
gauge's cord rings while its stage moves, so the row `moving` holds an error of the fake's gauge as well. A
pull on the intermediate section is judged with a calibration that has seen the tip pulled only. The fake
hands show the vented arm poses of their own choice; teach mode counts them all, and once more those that
pressures can reach.

"""


def experiments_page(tables: Sequence[Table], seeds: int) -> str:
    """Write the page.

    Args:
        tables: What was printed.
        seeds: Number of fake arms.
    """
    return HEAD.format(seeds=seeds) + as_markdown(*(table for table in tables if table.rows)) + "\n"
