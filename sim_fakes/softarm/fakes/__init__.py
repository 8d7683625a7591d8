"""Fake instruments that speak the real wire protocols, driven by a fake arm."""
