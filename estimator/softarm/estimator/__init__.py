"""Shape and force of a soft arm from a finite-element model and a few measurements.

Pure and synchronous: no clock, no threads of its own but the background factorisation, no network.
Each sub-package is one concept and its ``__init__`` is its door.
"""
