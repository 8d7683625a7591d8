"""Estimate the forces on a recorded arm: ``python examples/estimate_recording.py RECORDING SPECIMEN``."""

import sys
from typing import Any

from softarm.analysis.offline.inputs import check_and_correct
from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import track
from softarm.common.rods import known_trusted_rod
from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import arrange
from softarm.estimator.model import ArmModel
from softarm.estimator.specimen import load_specimen
from softarm.recordings import load_recording

path, arm = sys.argv[1:]
specimen = load_specimen(arm)
recording = check_and_correct(load_recording(path, units_checked=False), specimen, print).for_estimates
run = resample(arrange(recording, specimen), rate=2.0)
model: ArmModel[Any, Any] = known_trusted_rod(specimen) or build_arm(specimen)
estimates = track(model, specimen, run)
for k, load in enumerate(estimates.loads):
    for time, force, std in zip(run.time, estimates.forces[:, k], estimates.force_std[:, k], strict=True):
        print(f"{time:.2f} s: {load.name} {force:.3f} N, standard deviation {std:.3f} N")
