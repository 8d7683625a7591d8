"""Diagnosis: from the mismatch between model and recording to the physics that was left out."""
