"""``softarm bench verify``: the finite elements against published and analytic answers."""

from itertools import chain

import click

from acceptance.verification.bodies import body_results
from acceptance.verification.elements import element_results
from acceptance.verification.held import HeldResult
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table


def row(result: HeldResult) -> dict[str, Cell]:
    """Return the table's row of one check."""
    return {
        "check": result.check,
        "case": result.case,
        "expected": result.expected,
        "found": result.found,
        "error": result.error,
        "limit": result.limit,
        "passes": result.passed,
        "source": result.source,
    }


@click.command()
@quick_option
@json_option
def command(quick: bool, as_json: bool) -> int:
    """Check the finite elements against published and analytic answers.

    The benchmark runs the patch test, rigid modes and order of convergence of every element, a thick-walled
    cylinder, the elastica and Cook's membrane. The exit status is 1 if an error exceeds its limit.

    Example: softarm bench verify --quick
    """
    results = []
    with progress("Checks") as advance:
        for result in chain(element_results(quick), body_results(quick)):
            results.append(result)
            advance(1)
    show(Table("Finite elements against known answers", [row(result) for result in results]), as_json=as_json)
    return 0 if all(result.passed for result in results) else 1
