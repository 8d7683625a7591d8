"""The description of one robot, as read from a TOML file and written back to one."""

from estimator.specimen.body import Chamber, Clamp, Fibres, Marker, Section, Segment, SensorNoise
from estimator.specimen.calibration import (
    BendCalibration,
    Calibration,
    ChamberCalibration,
    FrameCalibration,
)
from estimator.specimen.entry import Value
from estimator.specimen.files import SHIPPED, load_specimen, parse_specimen, save_specimen, specimen_table
from estimator.specimen.geometry import Block, Geometry, MeshFile, QuadrantCylinder, SweptLobes
from estimator.specimen.material import Corotational, Gent, Material, NeoHookean, Softening, Yeoh
from estimator.specimen.physics import EffectName, Parameter, Physics, Place
from estimator.specimen.problems import SpecimenError
from estimator.specimen.specimen import Specimen

__all__ = [
    "SHIPPED",
    "BendCalibration",
    "Block",
    "Calibration",
    "Chamber",
    "ChamberCalibration",
    "Clamp",
    "Corotational",
    "EffectName",
    "Fibres",
    "FrameCalibration",
    "Gent",
    "Geometry",
    "Marker",
    "Material",
    "MeshFile",
    "NeoHookean",
    "Parameter",
    "Physics",
    "Place",
    "QuadrantCylinder",
    "Section",
    "Segment",
    "SensorNoise",
    "Softening",
    "Specimen",
    "SpecimenError",
    "SweptLobes",
    "Value",
    "Yeoh",
    "load_specimen",
    "parse_specimen",
    "save_specimen",
    "specimen_table",
]
