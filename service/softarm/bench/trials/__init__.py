"""Blind trials of a diagnosis: read from folders, diagnosed, and scored where there are answers."""
