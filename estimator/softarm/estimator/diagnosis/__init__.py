"""Diagnosis: from the mismatch between model and recording to the physics that was left out."""

from softarm.estimator.diagnosis.result import Diagnosis, Finding, Verdict

__all__ = ["Diagnosis", "Finding", "Verdict"]
