"""Drivers of the instruments around a soft arm; they import nothing else of the project."""
