"""The diagnosis of recordings: what is read, run, reported and written."""
