"""Modes, health findings, the lease and what reaches the valves."""
