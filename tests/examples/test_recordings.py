"""The program that made the example recordings still makes them."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from softarm.recordings import load_recording

FOLDER = Path(__file__).parents[2] / "examples" / "recordings"


@pytest.fixture
def make() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_recordings", FOLDER / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_valve_is_made_as_it_is_shipped(make: ModuleType) -> None:
    made, shipped = make.low_valve(), load_recording(FOLDER / "valve_low")
    for name, values in shipped.columns.items():
        np.testing.assert_array_equal(made.columns[name], values)


def test_the_pulled_arm_is_made_with_the_columns_and_bends_that_are_shipped(
    make: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(make, "RATE", 1.0)
    made, shipped = make.pulled_arm(), load_recording(FOLDER / "sopra_pull")
    assert set(made.columns) == set(shipped.columns)
    rows = np.searchsorted(shipped.time, made.time)
    for name, values in made.columns.items():
        if name.startswith("bend_"):
            np.testing.assert_allclose(values, shipped.columns[name][rows], atol=0.02)
