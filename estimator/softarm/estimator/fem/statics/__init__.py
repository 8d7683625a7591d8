"""Equilibria under fixed inputs: Newton iteration, continuation along a path of loads, and outcomes."""
