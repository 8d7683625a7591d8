"""The experiments of the paper, live over zenoh, and their tables."""
