"""Where rods come from: the cache or a fit; and which of them may stand in for the finite elements."""

import pytest

import softarm.common.rods as rods
from softarm.common.errors import WorkFailedError
from softarm.common.shipped import fake_specimen
from softarm.estimator.rod import FittedRod, HeldOut, HeldOutReport, shape_key
from softarm.estimator.rod.archive import to_bytes
from softarm.estimator.specimen import load_specimen
from tests.estimator.rod.linear_rod import linear_rod


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "softarm" / "rods"


def fitted(error: float = 0.004, lost: int = 0) -> FittedRod:
    found = HeldOut(10, lost, 1e-3, 2e-3, 1e-4, 2e-4, error, 2 * error, (1.0, 0.2))
    return FittedRod(linear_rod(8, quadratic=1e-3), HeldOutReport(found, found), 100, 2)


def specimen(wall: float = 0.0021):
    sopra = load_specimen(fake_specimen())
    return sopra.model_copy(update={"geometry": sopra.geometry.model_copy(update={"wall_m": wall})})


@pytest.fixture
def fits(monkeypatch):
    """Count fits, each of which gives a rod that is known."""
    made: list[str] = []

    def fit(described, progress=None, recipe=None) -> FittedRod:
        made.append(described.name)
        return fitted()

    monkeypatch.setattr(rods, "fit_now", fit)
    return made


def test_a_fit_is_kept_and_found_again_as_it_was(fits, cache) -> None:
    first = rods.rod_for(specimen())
    again = rods.rod_for(specimen())
    assert fits == ["sopra"]
    assert [file.suffix for file in cache.iterdir()] == [".npz"]
    assert (first.laws.coefficients[..., :6] == again.laws.coefficients[..., :6]).all()
    known = rods.known_rod(specimen())
    assert known is not None
    assert known.report == fitted().report


def test_a_calibrated_specimen_has_its_own_stiffness(fits) -> None:
    rod = rods.rod_for(specimen())
    scales = [specimen().calibration.scale(region) for region in ("upper", "lower")]
    assert scales != [1.0, 1.0]
    assert rod.laws.stiffness.tolist() == [scales[0]] * 4 + [scales[1]] * 4


def test_a_quick_rod_is_kept_beside_a_whole_one_and_never_taken_for_it(fits, cache) -> None:
    for _ in range(2):
        rods.fitted_rod(specimen(), recipe=rods.QUICK)
    assert rods.known_rod(specimen()) is None
    rods.fitted_rod(specimen())
    assert fits == ["sopra"] * 2
    assert len(list(cache.iterdir())) == 2


def test_a_damaged_or_foreign_file_in_the_cache_is_fitted_over(fits, cache) -> None:
    rods.rod_for(specimen())
    (file,) = cache.iterdir()
    file.write_bytes(file.read_bytes()[:100])
    rods.rod_for(specimen())
    file.write_bytes(to_bytes(fitted(), shape_key(specimen(0.0022)), "other"))
    rods.rod_for(specimen())
    assert fits == ["sopra"] * 3


def test_a_cache_that_cannot_be_written_is_done_without(fits, tmp_path, monkeypatch) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert rods.rod_for(specimen()).loads


def test_a_rod_that_is_off_does_not_stand_in_for_the_finite_elements(monkeypatch) -> None:
    assert rods.trusted(fitted())
    assert not rods.trusted(fitted(lost=1))
    monkeypatch.setattr(rods, "fit_now", lambda *_: fitted(error=0.09))
    with pytest.raises(WorkFailedError, match=r"9 % of their range off.*use the model fem"):
        rods.trusted_rod(specimen())
