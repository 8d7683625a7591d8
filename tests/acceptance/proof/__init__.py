"""``softarm bench proof``: the proof of the diagnosis on the fake arm and against its alternatives."""

from acceptance.proof.command import command

__all__ = ["command"]
