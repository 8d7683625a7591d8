"""Time, frames, labels and units of a recording, before any calibration.

| fault | found by | corrected |
|---|---|---|
| chambers, sections or markers of another specimen | names | no |
| units, absolute pressures, sign of a gauge | what the specimen can be | where one unit wins |
| unit of time | the stated rate | yes |
| zeros of a lost body, spikes | single readings far off their neighbours | counted as lost |
| a laboratory frame without the base | rest, directions in which pressures bend the arm | no |
| late or early clock | regression on shifted pressures | where one shift wins |
| exchanged markers or sections, mirrored laboratory | rigid sections | where one labelling wins |
| pressures above the limit | the limit | left out of fits |
| events | the steady law of the recording itself | left out of fits |
"""

from softarm.estimator.intake.intake import check_recording
from softarm.estimator.intake.result import Disturbance, Intake, RecordingFault

__all__ = ["Disturbance", "Intake", "RecordingFault", "check_recording"]
