"""The estimator in a separate process."""
