"""Blind trials of a diagnosis: read from folders, diagnosed, and scored where answers are given."""
