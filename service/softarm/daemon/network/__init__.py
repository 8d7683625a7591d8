"""zenoh: sessions, the service's side of the keys, and the client's."""
