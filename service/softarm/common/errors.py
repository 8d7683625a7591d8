"""The error of work that failed although the user did nothing wrong."""


class WorkFailedError(Exception):
    """Something outside refused or did not answer; the command line reports one line and exits with 1."""
