"""The description of one robot, as read from a TOML file and written back to one."""

from softarm.estimator.specimen.body import Chamber, Clamp, Fibres, Marker, Section, Segment, SensorNoise
from softarm.estimator.specimen.calibration import (
    BendCalibration,
    Calibration,
    ChamberCalibration,
    FrameCalibration,
)
from softarm.estimator.specimen.entry import Value
from softarm.estimator.specimen.files import (
    SHIPPED,
    load_specimen,
    parse_specimen,
    require_free_specimen,
    save_specimen,
    specimen_table,
)
from softarm.estimator.specimen.geometry import (
    Block,
    Cylinder,
    Geometry,
    MeshFile,
    QuadrantCylinder,
    SweptLobes,
)
from softarm.estimator.specimen.material import Corotational, Gent, Material, NeoHookean, Softening, Yeoh
from softarm.estimator.specimen.physics import EffectName, Parameter, Physics, Place
from softarm.estimator.specimen.problems import SpecimenError
from softarm.estimator.specimen.specimen import Specimen

__all__ = [
    "SHIPPED",
    "BendCalibration",
    "Block",
    "Calibration",
    "Chamber",
    "ChamberCalibration",
    "Clamp",
    "Corotational",
    "Cylinder",
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
    "require_free_specimen",
    "save_specimen",
    "specimen_table",
]
