"""The daemon beside the arm, the command line, and the recordings."""
