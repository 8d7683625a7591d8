"""The instruments of a scenario on the arm that it plays, where it does not place them itself."""

from collections.abc import Sequence

from softarm.estimator.specimen import load_specimen
from softarm.fakes.parts import (
    AnyDevice,
    BendPart,
    BodyPart,
    DevicePart,
    InertialPart,
    QtmPart,
    QuaternionLinePart,
    ValvesPart,
)
from softarm.fakes.plant.shape import has_shape_of_sopra
from softarm.fakes.plant.state import Plant
from softarm.fakes.scenario import Scenario

PLACEMENTS = ("valve_map", "bodies", "sensors", "section", "sections")


def with_specimen(scenario: Scenario, specimen: str) -> Scenario:
    """Return a scenario whose arm is that of a specimen, without the places of its instruments.

    The scenario stays as it is where the specimen has the shape of SoPrA.

    Args:
        scenario: What there is.
        specimen: A file, or the name of a shipped one.
    """
    if has_shape_of_sopra(load_specimen(specimen)):
        return scenario
    table = scenario.model_dump(exclude_unset=True, exclude={"cord", "device"})
    table["plant"] = {**table.get("plant", {}), "specimen": specimen}
    devices = [device.model_dump(exclude_unset=True) for device in scenario.device]
    table["device"] = [{k: v for k, v in device.items() if k not in PLACEMENTS} for device in devices]
    return Scenario.model_validate(table)


def with_placed_instruments(scenario: Scenario, plant: Plant) -> Scenario:
    """Place the instruments of a scenario that plays a specimen.

    A device whose table states its place stays there. The others: one valve per chamber in its order, a body
    on each section, a bend sensor on each segment, inertial units on the last section.
    """
    if scenario.plant.specimen is None:
        return scenario
    devices = tuple(_placed(device, plant) for device in scenario.device)
    return scenario.model_copy(update={"device": devices})


def _placed(part: AnyDevice, plant: Plant) -> AnyDevice:
    places = _places(part, plant)
    return part.model_copy(update={k: v for k, v in places.items() if k not in part.model_fields_set})


def _places(part: DevicePart, plant: Plant) -> dict[str, Sequence[object] | str]:
    """Return where a device goes on an arm, by the key of its table."""
    if isinstance(part, ValvesPart):
        return {"valve_map": tuple(range(plant.chambers))}
    if isinstance(part, QtmPart):
        return {"bodies": tuple(BodyPart(name=name, section=name) for name in plant.sections)}
    if isinstance(part, BendPart):
        return {"sensors": tuple(reversed(plant.segments))}
    if isinstance(part, QuaternionLinePart):
        return {"sections": plant.sections[1:]}
    return {"section": plant.sections[-1]} if isinstance(part, InertialPart) else {}
