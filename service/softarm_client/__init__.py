"""A client of the softarm service: the streams of an arm, its commands, its lease and its recordings."""

from softarm_client.arm import STALE_S, ActiveRecording, Arm
from softarm_client.errors import (
    ClientError,
    CommandRefusedError,
    ServiceSilentError,
    SetupError,
    UnreachableError,
)
from softarm_client.lease import HeldLease
from softarm_client.messages import Estimate, Event, Mismatch, State
from softarm_client.modes import Mode
from softarm_client.streams import Stream

__all__ = [
    "STALE_S",
    "ActiveRecording",
    "Arm",
    "ClientError",
    "CommandRefusedError",
    "Estimate",
    "Event",
    "HeldLease",
    "Mismatch",
    "Mode",
    "ServiceSilentError",
    "SetupError",
    "State",
    "Stream",
    "UnreachableError",
]
