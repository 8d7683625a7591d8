"""The daemon beside an arm: acquisition, estimation, control, safety and its network."""
