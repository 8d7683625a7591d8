"""Benchmarks that developers run in a checkout: each module is a command of ``softarm bench``."""
