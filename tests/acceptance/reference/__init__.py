"""``softarm bench reference``: write the reference pages of ``docs/`` from the definitions they describe."""

from pathlib import Path

import click

from acceptance.reference import api, configuration, specimen
from softarm.cli.output import notify

DOCS = Path(__file__).parents[3] / "docs"
PAGES = {"api.md": api.render, "configuration.md": configuration.render, "specimen.md": specimen.render}


@click.command()
def command() -> None:
    """Write the pages of the network, the configuration and the specimen.

    Example: softarm bench reference
    """
    for name, render in PAGES.items():
        (DOCS / name).write_text(render(), "utf-8")
        notify(f"wrote docs/{name}")
