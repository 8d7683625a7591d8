"""A client of the softarm service: the streams of an arm, its commands, its lease and its recordings."""
