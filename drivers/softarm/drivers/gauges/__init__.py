"""Force gauges on a serial line."""
