"""The same equilibria as SOFA's on its own mesh."""

import os
from pathlib import Path

import pytest

from acceptance.sofa import (
    CONVERGED,
    DISPLACEMENT_LIMIT,
    FORCE_LIMIT_N,
    INVERSE,
    INVERSE_STEPS,
    PUBLISHED,
    Inverse,
    forward,
    read_reference,
    side_by_side,
)

FOLDER = Path(os.environ.get("SOFARM_SOFA", "../shared/reference/sofa"))
pytestmark = pytest.mark.timeout(600)
needs_reference = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"SOFA's reference is not at {FOLDER}")


@needs_reference
def test_equilibria_agree() -> None:
    rows = list(forward(read_reference(FOLDER, "sopra_464")))
    assert {row["method"] for row in rows} == {"small", "large", "polar"}
    assert max(float(row["worst_relative_error"] or 0.0) for row in rows) < DISPLACEMENT_LIMIT


@needs_reference
def test_forces_are_recovered_and_stand_beside_what_is_published() -> None:
    reference = read_reference(FOLDER, "sopra_464")
    found = Inverse(reference).follow(8, CONVERGED)
    assert found.not_converged == 0
    assert found.rmse_mn < 1e3 * FORCE_LIMIT_N
    rows = {row["step"]: row for row in side_by_side(reference, 2, found)}
    assert rows.keys() >= PUBLISHED["sopra_464"].keys()
    once, converged = rows[INVERSE_STEPS[0]], rows[INVERSE]
    assert once["sofa_ms"] == 7.4
    assert once["sofa_rmse_mn"] == 1.24
    assert float(once["force_rmse_mn"] or 0.0) > found.rmse_mn == converged["force_rmse_mn"]
