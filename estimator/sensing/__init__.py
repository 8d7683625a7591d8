"""Sensors of the arm: poses, orientations, bends, markers and gauges, any subset present at an instant."""

from estimator.sensing.actuation import ActuationMap
from estimator.sensing.bend import Bend
from estimator.sensing.gauge import GaugeForce
from estimator.sensing.marker import Marker
from estimator.sensing.measurement import Measurement, Scene, Sensitivity
from estimator.sensing.orientation import Orientation
from estimator.sensing.registration import Registration, register
from estimator.sensing.section_pose import SectionPose
from estimator.sensing.suite import Observation, SensorSuite

__all__ = [
    "ActuationMap",
    "Bend",
    "GaugeForce",
    "Marker",
    "Measurement",
    "Observation",
    "Orientation",
    "Registration",
    "Scene",
    "SectionPose",
    "Sensitivity",
    "SensorSuite",
    "register",
]
