"""Run ``python -m service`` as ``softarm``."""

from service.cli import main

main()
