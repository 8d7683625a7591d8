from dataclasses import replace

import pytest

from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.effects import Concealed
from softarm.fakes.plant.parameters import ArmParameters, sopra
from tests.sim_fakes.plant.driving import MakeArm


def coarse(parameters: ArmParameters) -> ArmParameters:
    """The same arm with few links and long steps, which is quick."""
    return replace(parameters, segments=tuple(replace(s, links=3) for s in parameters.segments), step=4e-3)


@pytest.fixture(scope="session")
def small() -> ArmParameters:
    return coarse(sopra())


@pytest.fixture
def make_arm(small: ArmParameters) -> MakeArm:
    """Make a quick arm with effects."""

    def make(*effects: Concealed, parameters: ArmParameters = small) -> FakeArm:
        return FakeArm(parameters, effects)

    return make
