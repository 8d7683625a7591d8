import pytest

from softarm.estimator.model import Load
from tests.estimator.inverse.toy_arm import ToyArm


@pytest.fixture
def arm() -> ToyArm:
    axes = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
    return ToyArm(
        tuple(
            Load(f"{section}_{name}", "force", axis, section=section)
            for section in ("intermediate", "tip")
            for name, axis in axes.items()
        )
    )
