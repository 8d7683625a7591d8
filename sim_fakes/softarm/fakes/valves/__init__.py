"""Fake valve terminals: CPX with MPA proportional valves, and VTEM, over Modbus TCP."""
