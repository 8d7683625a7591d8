"""Sensors of the arm: poses, orientations, bends, markers and gauges, any subset present at an instant."""

from softarm.estimator.sensing.actuation import ActuationMap
from softarm.estimator.sensing.bend import Bend
from softarm.estimator.sensing.marker import MarkerPosition
from softarm.estimator.sensing.measurement import Measurement
from softarm.estimator.sensing.model_error import ModelError, widened
from softarm.estimator.sensing.orientation import Orientation
from softarm.estimator.sensing.registration import Registration, register
from softarm.estimator.sensing.section_pose import MeasuredPose
from softarm.estimator.sensing.suite import SensorSuite

__all__ = [
    "ActuationMap",
    "Bend",
    "MarkerPosition",
    "MeasuredPose",
    "Measurement",
    "ModelError",
    "Orientation",
    "Registration",
    "SensorSuite",
    "register",
    "widened",
]
