"""The arms that a scenario can name."""

from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.fakes.plant.state import Plant
from softarm.fakes.scenario import PlantPart
from softarm.fakes.still import StillArm


def build_plant(part: PlantPart, seed: int) -> Plant:
    """Build the arm of a scenario, without its concealed effects.

    Args:
        part: What the scenario says of it.
        seed: Draws the tolerances of an arm that plays a specimen.

    Raises:
        InputError: The physics engine is not installed, or no fake arm can have the specimen's shape.
    """
    if part.kind == "arm":
        return _dynamic_arm(part.specimen, seed)
    if part.specimen is not None:
        raise InputError("scenario, plant.kind", "'still' plays no specimen", "take kind = 'arm'")
    return StillArm()


def _dynamic_arm(specimen: str | None, seed: int) -> Plant:
    """Load the physics engine, which the still arm does without."""
    try:
        from softarm.fakes.plant.arm import FakeArm
        from softarm.fakes.plant.from_specimen import arm_of
    except ModuleNotFoundError as error:
        cure = "install softarm[fakes], or take kind = 'still'"
        raise InputError("scenario, plant.kind", f"{error.name} is not installed", cure) from None
    return FakeArm(arm_of(None if specimen is None else load_specimen(specimen), seed).arm)
