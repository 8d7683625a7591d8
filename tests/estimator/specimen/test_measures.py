"""Measures of an arm become its specimen; those that do not fit together are refused."""

import math
from dataclasses import replace

import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.estimator.specimen.measures import (
    ArmMeasures,
    CylinderMeasures,
    LobeMeasures,
    SegmentMeasures,
    specimen_of_measures,
)

SOPRA = ArmMeasures(
    name="mine",
    base_m=0.010,
    segments=(
        SegmentMeasures(0.120, 0.160, 0.021, 0.020),
        SegmentMeasures(0.120, 0.082, 0.005, 0.023),
    ),
    shape=LobeMeasures(radii_m=(0.0175, 0.0140, 0.0099), wall_m=0.002, floor_m=0.002),
    soft_young_pa=264e3,
    rigid_young_pa=1140e3,
    density_kg_m3=1070.0,
    pressure_limit_pa=65e3,
    wound=True,
)


def test_the_measures_of_sopra_give_the_shipped_arm():
    mine, shipped = specimen_of_measures(SOPRA), load_specimen("sopra")
    assert mine.geometry == shipped.geometry
    assert mine.fibres == shipped.fibres
    assert [(s.name, s.from_m, s.to_m, s.mass_kg) for s in mine.segments] == [
        (s.name, s.from_m, s.to_m, s.mass_kg) for s in shipped.segments
    ]
    assert [(s.name, s.from_m, s.to_m, s.frame_origin_m) for s in mine.sections] == [
        (s.name, s.from_m, s.to_m, s.frame_origin_m) for s in shipped.sections
    ]
    for own, other in zip(mine.chambers, shipped.chambers, strict=True):
        assert own.azimuth_rad == pytest.approx(other.azimuth_rad)
        assert replace_azimuth(own) == replace_azimuth(other)
    assert mine.materials["soft"].young == pytest.approx(264e3)


def replace_azimuth(chamber):
    return chamber.model_copy(update={"azimuth_rad": 0.0})


@pytest.mark.parametrize("count", [1, 3])
def test_other_numbers_of_segments_keep_base_and_tip(count: int):
    lobes = LobeMeasures((0.0140,) * (count + 1), wall_m=0.002, floor_m=0.002)
    arm = specimen_of_measures(replace(SOPRA, segments=(SOPRA.segments[1],) * count, shape=lobes))
    assert len(arm.segments) == count
    assert [arm.sections[0].name, arm.sections[-1].name] == ["base", "tip"]
    assert [chamber.index for chamber in arm.chambers] == list(range(3 * count))


def test_walls_that_leave_no_room_for_a_chamber_are_refused():
    with pytest.raises(InputError, match="no room for a chamber"):
        specimen_of_measures(replace(SOPRA, shape=replace(SOPRA.shape, wall_m=0.012)))


@pytest.mark.parametrize("chambers", [2, 5])
def test_a_cylinder_has_as_many_chambers_as_asked_for(chambers: int):
    shape = CylinderMeasures(chambers, outer_radius_m=0.018, wall_m=0.0025, core_radius_m=0.006)
    arm = specimen_of_measures(replace(SOPRA, shape=shape))
    assert arm.geometry.kind == "cylinder"
    assert [chamber.segment for chamber in arm.chambers] == ["upper"] * chambers + ["lower"] * chambers
    assert arm.chambers[chambers + 1].azimuth_rad == pytest.approx(2.0 * math.pi / chambers)
