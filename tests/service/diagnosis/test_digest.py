"""A diagnosis is done again when, and only when, something that went into it has changed."""

from dataclasses import replace
from pathlib import Path

import pytest

from softarm.analysis.diagnosis.digest import (
    _sources,
    digest_of,
    report_up_to_date,
    require_free_folder,
    specimen_up_to_date,
    write_digest,
    write_report,
)
from softarm.analysis.diagnosis.report import report_of
from softarm.analysis.diagnosis.run import DiagnosisRequest
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from tests.service.diagnosis.made_diagnosis import diagnosis


@pytest.fixture
def request_of(tmp_path: Path) -> DiagnosisRequest:
    for name in ("run", "known"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "recording.csv").write_text("t_s,pressure_0_pa\n0,0\n")
    return DiagnosisRequest((tmp_path / "run",), (tmp_path / "known",), load_specimen("sopra"))


def test_the_same_diagnosis_is_known_again(request_of: DiagnosisRequest, tmp_path: Path) -> None:
    out = tmp_path / "out"
    report = report_of(diagnosis())
    digest = digest_of(request_of)
    assert report_up_to_date(out, digest) is None
    write_report(report, out)
    assert report_up_to_date(out, digest) is None  # killed before all was written
    write_digest(digest, out)
    assert report_up_to_date(out, digest) == report
    write_report(report, out)
    assert report_up_to_date(out, digest) is None
    write_digest(digest, out)
    (out / "report.json").write_text("{}")
    assert report_up_to_date(out, digest) is None
    (out / "report.json").unlink()
    assert report_up_to_date(out, digest) is None


def test_the_diagnosis_of_other_recordings_is_not_replaced(
    request_of: DiagnosisRequest, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    require_free_folder(out, request_of, force=False)
    write_report(report_of(replace(diagnosis(), recordings=("run",))), out)
    require_free_folder(out, request_of, force=False)  # the same recordings, with another program perhaps
    write_report(report_of(replace(diagnosis(), recordings=("other",))), out)
    require_free_folder(out, request_of, force=True)
    with pytest.raises(InputError, match=r"holds the diagnosis of other; choose another --out"):
        require_free_folder(out, request_of, force=False)
    blocked = tmp_path / "run" / "recording.csv" / "out"
    with pytest.raises(InputError, match="cannot be made"):
        require_free_folder(blocked, request_of, force=False)


def test_a_specimen_that_was_written_is_known_until_it_is_changed(tmp_path: Path) -> None:
    specimen = tmp_path / "mine.toml"
    specimen.write_text("a = 1\n")
    write_digest("digest", tmp_path)
    assert not specimen_up_to_date(tmp_path, specimen)
    write_digest("digest", tmp_path, specimen)
    assert specimen_up_to_date(tmp_path, specimen)
    assert not specimen_up_to_date(tmp_path, tmp_path / "other.toml")
    specimen.write_text("a = 2\n")
    assert not specimen_up_to_date(tmp_path, specimen)


def test_whatever_goes_in_counts(request_of: DiagnosisRequest, tmp_path: Path) -> None:
    digest = digest_of(request_of)
    assert digest_of(request_of) == digest
    others = [
        replace(request_of, seed=1),
        replace(request_of, effects=("line_lag",)),
        replace(request_of, nominal=()),
        replace(request_of, recordings=request_of.nominal, nominal=request_of.recordings),
        replace(request_of, specimen=load_specimen("beam")),
    ]
    (tmp_path / "run" / "recording.csv").write_text("t_s,pressure_0_pa\n0,1\n")
    assert len({digest, digest_of(request_of), *map(digest_of, others)}) == 7


def test_compiled_code_does_not_count() -> None:
    """It is kept beside the sources, and changes as functions are compiled."""
    files = list(_sources())
    assert not [path for path in files if "__pycache__" in path.parts]
    assert {"sopra.npz", "sopra.toml", "choose.py", "load.py", "rods.py"} <= {path.name for path in files}


def test_what_is_known_of_a_run_counts_where_its_table_is_given(tmp_path: Path) -> None:
    table = tmp_path / "run.csv"
    table.write_text("t_s,pressure_0_pa\n0,0\n")
    wanted = DiagnosisRequest((table,), (), load_specimen("sopra"))
    digest = digest_of(wanted)
    (tmp_path / "run.toml").write_text("rate_hz = 10.0\n")
    assert digest_of(wanted) != digest
