"""The control loop: ticks, snapshots, modes in action."""
