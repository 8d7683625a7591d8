"""Run ``python -m softarm`` as ``softarm``."""

from softarm.cli import main

main()
