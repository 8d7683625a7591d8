"""A fake Qualisys Track Manager: the RT protocol over TCP and UDP, and discovery."""
