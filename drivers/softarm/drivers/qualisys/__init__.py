"""Motion capture with Qualisys Track Manager."""
