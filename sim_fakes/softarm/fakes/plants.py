"""The arms that a scenario can name."""

from softarm.estimator.errors import InputError
from softarm.fakes.plant.state import Plant
from softarm.fakes.scenario import PlantPart
from softarm.fakes.still import StillArm


def build_plant(part: PlantPart) -> Plant:
    """Build the arm of a scenario, without its concealed effects.

    Raises:
        InputError: The physics engine is not installed.
    """
    return _dynamic_arm() if part.kind == "arm" else StillArm()


def _dynamic_arm() -> Plant:
    """Load the physics engine, which the still arm does without."""
    try:
        from softarm.fakes.plant.arm import FakeArm
    except ModuleNotFoundError as error:
        cure = "install softarm[fakes], or take kind = 'still'"
        raise InputError("scenario, plant.kind", f"{error.name} is not installed", cure) from None
    return FakeArm()
