"""Fake serial instruments on pseudo-terminals."""
