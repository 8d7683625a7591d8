"""Bend sensors on a serial line."""
