"""A client of the service: sessions with safe defaults, streams and commands."""
