"""The page of the experiments, from the tables that a campaign printed."""

from collections.abc import Sequence

from service.cli.output import Table, as_markdown

HEAD = """# The paper's experiments

Printed by `softarm experiment all --fake --seeds {seeds} --write docs/experiments.md`. Cangan et al. measured
on a SoPrA arm; these figures are of fake arms, whose physics is not the estimator's
([fake-arm.md](fake-arm.md)). An aim that is missed says so in the column `aim met`.

"""


def experiments_page(tables: Sequence[Table], seeds: int) -> str:
    """Write the page.

    Args:
        tables: What was printed.
        seeds: Number of fake arms.
    """
    return HEAD.format(seeds=seeds) + as_markdown(*(table for table in tables if table.rows)) + "\n"
