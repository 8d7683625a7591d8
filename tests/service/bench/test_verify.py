"""The finite elements against published and analytic answers, as ``softarm bench verify`` runs them."""

from collections.abc import Callable, Iterator

import pytest

from acceptance.verification import bodies, elements
from acceptance.verification.held import HeldResult


@pytest.mark.parametrize("checks", [elements.element_results, bodies.body_results])
def test_known_answers_are_met(checks: Callable[[bool], Iterator[HeldResult]]) -> None:
    results = list(checks(True))
    assert results
    assert [result for result in results if not result.passed] == []


def test_linear_tetrahedra_lock_where_the_check_says_so() -> None:
    """The check can fail: linear tetrahedra are far too stiff near incompressibility."""
    assert not bodies.cook_membrane("tet4", 8, 0.02).passed
