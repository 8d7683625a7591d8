"""The same equilibria as SOFA's on its own mesh."""

import os
from pathlib import Path

import pytest

from acceptance.sofa import DISPLACEMENT_LIMIT, FORCE_LIMIT_N, forward, inverse, read_reference

FOLDER = Path(os.environ.get("SOFARM_SOFA", "../shared/reference/sofa"))
pytestmark = pytest.mark.timeout(600)
needs_reference = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"SOFA's reference is not at {FOLDER}")


@needs_reference
def test_equilibria_agree() -> None:
    rows = list(forward(read_reference(FOLDER, "sopra_464")))
    assert {row["method"] for row in rows} == {"small", "large", "polar"}
    assert max(float(row["worst_relative_error"] or 0.0) for row in rows) < DISPLACEMENT_LIMIT


@needs_reference
def test_forces_are_recovered() -> None:
    row = inverse(read_reference(FOLDER, "sopra_464"), samples=8)
    assert row["not_converged"] == 0
    assert float(row["force_rmse_mn"] or 0.0) < 1e3 * FORCE_LIMIT_N
