"""Benchmarks: each module prints one table and is a command of ``softarm bench``."""
