"""The calibrated rod of a specimen: shipped, from the user's cache, or fitted on the spot."""

import contextlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from softarm.common.errors import WorkFailedError
from softarm.estimator.errors import InputError
from softarm.estimator.files import write_whole
from softarm.estimator.rod.archive import from_bytes, shape_key, shipped_rod, to_bytes
from softarm.estimator.rod.fit import FittedRod, Recipe, adapted, fit_rod, sampled_model
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rod.samples import Progress, SamplingPlan
from softarm.estimator.specimen import Specimen

THREADS = 2
QUICK = Recipe(plan=SamplingPlan(rays=32, soft=3.0), check=SamplingPlan(rays=1, seed=101, pressure=1.0))
"""Fewer samples than usual, for a diagnosis of an arm whose rod nobody fitted: it must end.

They lead on until the arm is three times as soft: one that lengthens by a third under its pressures is past
1.5 long before it is about to buckle.
"""
LARGEST_FORCE_ERROR = 0.02
"""Held-out error of a force over its range up to which a rod may stand in for the finite elements."""


def cache_directory() -> Path:
    """Return the folder of fitted rods, after the XDG base directories."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "softarm" / "rods"


def rod_for(specimen: Specimen, progress: Progress | None = None) -> CalibratedRod:
    """Return the rod of a specimen as calibrated, with the default loads, however near it is.

    Args:
        specimen: Description.
        progress: Called with the steps done and all of them, should it be fitted, which takes minutes.

    Raises:
        InputError: The specimen cannot be meshed.
    """
    return adapted(fitted_rod(specimen, progress).rod, specimen)


def trusted_rod(specimen: Specimen, progress: Progress | None = None) -> CalibratedRod:
    """Return the rod of a specimen as ``rod_for``, if it may stand in for the finite elements.

    Raises:
        InputError: The specimen cannot be meshed.
        WorkFailedError: The rod is too far from the finite elements.
    """
    fitted = fitted_rod(specimen, progress)
    if not trusted(fitted):
        error = 100.0 * fitted.report.trained.force_rms
        raise WorkFailedError(
            f"{specimen.name}: the rod's forces are {error:.2g} % of their range off the finite elements "
            f"(at most {100.0 * LARGEST_FORCE_ERROR:g} %); use the model fem"
        )
    return adapted(fitted.rod, specimen)


def trusted(fitted: FittedRod) -> bool:
    """Return whether a rod is near enough to the finite elements to stand in for them."""
    report = fitted.report.trained
    return report.lost == 0 and report.force_rms <= LARGEST_FORCE_ERROR


def known_trusted_rod(specimen: Specimen) -> CalibratedRod | None:
    """Return the stored rod of a specimen if it may stand in for the finite elements."""
    fitted = known_rod(specimen)
    return adapted(fitted.rod, specimen) if fitted is not None and trusted(fitted) else None


def known_rod(specimen: Specimen, recipe: Recipe | None = None) -> FittedRod | None:
    """Return the shipped or cached rod of a specimen's shape, None where it would have to be fitted."""
    key = shape_key(specimen, recipe)
    return shipped_rod(key) or _cached(key)


def fitted_rod(
    specimen: Specimen, progress: Progress | None = None, recipe: Recipe | None = None
) -> FittedRod:
    """Return the rod of a specimen's shape with its report; one that is fitted is kept in the cache."""
    fitted = known_rod(specimen, recipe)
    if fitted is not None:
        return fitted
    fitted = fit_now(specimen, progress, recipe)
    key = shape_key(specimen, recipe)
    with contextlib.suppress(OSError, InputError):  # two commands may fit the same rod at once
        write_whole({_path(key): to_bytes(fitted, key, specimen.name)})
    return fitted


def fit_now(specimen: Specimen, progress: Progress | None = None, recipe: Recipe | None = None) -> FittedRod:
    """Fit the rod of a specimen's shape anew."""
    with ThreadPoolExecutor(min(THREADS, os.cpu_count() or 1)) as executor:
        return fit_rod(specimen, sampled_model(specimen, recipe), progress, executor, recipe)


def _path(key: str) -> Path:
    return cache_directory() / f"{key[:32]}.npz"


def _cached(key: str) -> FittedRod | None:
    try:
        data = _path(key).read_bytes()
    except OSError:
        return None
    stored = from_bytes(data)
    return stored[0] if stored is not None and stored[1] == key else None
