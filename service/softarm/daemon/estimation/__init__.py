"""The estimator in a process of its own."""
