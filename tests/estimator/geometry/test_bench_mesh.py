"""The benchmark of meshes: its ratios, and its verdict."""

import json
from dataclasses import replace

import pytest
from click.testing import CliRunner

from acceptance.mesh import SHARES, MeshTrial, bend_table, bends, command, judge, respond
from softarm.estimator.geometry import DEFAULTS
from softarm.estimator.specimen import load_specimen


def test_the_verdict_holds_every_error_and_their_spread_to_its_limit() -> None:
    rows = judge({"force": -0.014, "upper": -0.002, "lower": -0.016})
    assert [row["passes"] for row in rows] == [True, True, False, False]
    assert rows[-1]["percent"] == pytest.approx(1.4)


def test_the_default_of_sopra_serves_force_and_pressure() -> None:
    """Against itself with every edge halved; the benchmark divides once more."""
    specimen = load_specimen("sopra")
    found = respond(specimen, MeshTrial("hex20", DEFAULTS["swept_lobes"]))
    finer = respond(specimen, MeshTrial("hex20", replace(DEFAULTS["swept_lobes"], refinement=2)))
    errors = {key: found.values[key] / finer.values[key] - 1.0 for key in finer.values}
    assert set(errors) == {"force", "upper", "lower"}
    assert max(map(abs, errors.values())) < 0.015
    assert max(errors.values()) - min(errors.values()) < 0.01


def test_the_command_prints_json_and_passes_the_beam() -> None:
    result = CliRunner().invoke(command, ["--quick", "--json", "--specimen", "beam"], standalone_mode=False)
    assert result.exception is None
    assert result.return_value == 0
    table, verdict = json.loads(result.stdout)["tables"]
    assert {"mesh", "nodes", "elements", "force"} == set(table["rows"][0])
    assert all(row["passes"] for row in verdict["rows"])


def test_bends_under_pressure_are_compared_with_a_finer_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    specimen = load_specimen("single_segment")
    coarse = bends(specimen, DEFAULTS["quadrant_cylinder"])
    assert 0.0 < coarse[0] < coarse[1] < coarse[2]
    assert coarse[2] / coarse[0] > SHARES[2] / SHARES[0]  # the chambers widen as they stretch
    monkeypatch.setattr("acceptance.mesh.bends", lambda _, r: [x / r.refinement for x in coarse])
    assert [row["percent"] for row in bend_table(specimen).rows] == pytest.approx([100.0] * 3)
