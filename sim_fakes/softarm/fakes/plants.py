"""The arms that a scenario can name."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.fakes.plant.state import Plant
from softarm.fakes.scenario import PlantPart
from softarm.fakes.still import StillArm


@dataclass(frozen=True)
class MountedArm:
    """An arm and how it was marked.

    Args:
        plant: The arm.
        misalignments: Rotation vector of each section's motion-capture body against the section [rad]; not
            rotated where it is not named.
    """

    plant: Plant
    misalignments: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)


def build_plant(part: PlantPart, seed: int) -> MountedArm:
    """Build the arm of a scenario, without its concealed effects.

    Args:
        part: Its entry in the scenario.
        seed: Draws the tolerances of an arm that plays a specimen, where ``variant`` does not.

    Raises:
        InputError: The physics engine is not installed, or no fake arm can have the specimen's shape.
    """
    if part.kind == "arm":
        return _dynamic_arm(part, seed)
    for name, value in (("specimen", part.specimen), ("variant", part.variant)):
        if value is not None:
            raise InputError("scenario, plant.kind", f"'still' takes no {name}", "take kind = 'arm'")
    return MountedArm(StillArm())


def _dynamic_arm(part: PlantPart, seed: int) -> MountedArm:
    """Load the physics engine, which the still arm does without."""
    # Imported here, since the engine is an extra that the still arm does not need.
    try:
        from softarm.fakes.plant.arm import FakeArm
        from softarm.fakes.plant.from_specimen import arm_of
        from softarm.fakes.plant.shape import has_shape_of_sopra
        from softarm.fakes.plant.variants import variant
    except ModuleNotFoundError as error:
        cure = "install softarm[fakes], or take kind = 'still'"
        raise InputError("scenario, plant.kind", f"{error.name} is not installed", cure) from None
    specimen = None if part.specimen is None else load_specimen(part.specimen)
    if part.variant is None:
        return MountedArm(FakeArm(arm_of(specimen, seed).arm))
    of_sopra = specimen is None or has_shape_of_sopra(specimen)
    drawn = variant(part.variant) if of_sopra else arm_of(specimen, part.variant)
    arm = FakeArm(drawn.arm)
    return MountedArm(arm, dict(zip(arm.sections, drawn.instruments.alignments, strict=True)))
