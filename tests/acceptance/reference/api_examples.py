"""What each verb does, and an example of its request and answer, for the API page."""

from collections.abc import Mapping
from dataclasses import dataclass, field

TOKEN = "9f86d081884c7d659a2feaa0c55ad015"
PRESSURES = [20000.0, 0.0, 0.0, 0.0, 0.0, 0.0]
VENTED = [0.0] * 6
RAMPED = {"pressures_pa": PRESSURES, "ramp_s": 2.0, "reachable": True, "note": "The pose can be reached."}


@dataclass(frozen=True)
class Example:
    """A verb on the API page.

    Args:
        does: What it does, in one or two sentences.
        mode: Mode after it.
        applied: What the answer holds.
        fields: Fields of the request beside those that all have.
    """

    does: str
    mode: str
    applied: Mapping[str, object] = field(default_factory=dict)
    fields: Mapping[str, object] = field(default_factory=dict)


EXAMPLES: Mapping[str, Example] = {
    "arm": Example(
        "Let the valves accept set-points; the chambers stay vented.", "ARMED", {"asked_pa": VENTED}
    ),
    "disarm": Example("Vent.", "IDLE", {"asked_pa": VENTED}),
    "stop": Example("Vent at once and latch a fault.", "FAULTED", {"asked_pa": VENTED}),
    "clear": Example(
        "Leave FAULTED once the cause is gone; the arm stays vented.",
        "IDLE",
        {"cleared": "stopped by ann", "acknowledged": False},
    ),
    "set_pressures": Example(
        "Ask for gauge pressures, one for each chamber, for a stated time.",
        "ARMED",
        {"asked_pa": PRESSURES, "lifetime_s": 0.5},
        {"pressures_pa": PRESSURES, "lifetime_s": 0.5},
    ),
    "teach/start": Example("Let the arm be moved by hand.", "TEACH", {"asked_pa": VENTED}),
    "teach/hold": Example(
        "Ramp to the pressures that hold the present pose, and hold it.", "HOLDING", RAMPED
    ),
    "teach/save": Example(
        "Save the present pose and its pressures under a name.",
        "HOLDING",
        {"name": "a", "pressures_pa": PRESSURES, "reachable": True, "note": "The pose can be reached."},
        {"name": "a"},
    ),
    "teach/list": Example("List the saved poses by name.", "IDLE"),
    "teach/goto": Example(
        "Ramp to a saved pose and hold it.", "HOLDING", {"name": "a", **RAMPED}, {"name": "a"}
    ),
    "teach/release": Example(
        "End teaching or holding; the pressures stay for their stated lifetime.",
        "ARMED",
        {"asked_pa": PRESSURES, "lifetime_s": 2.0},
    ),
    "estimate/tare": Example(
        "Take the present external force as zero.", "IDLE", {"loads_n": [0.01, -0.02, 0.0, 0.01]}
    ),
    "experiment/begin": Example("Begin an experiment.", "EXPERIMENT"),
    "experiment/end": Example("End an experiment.", "ARMED"),
    "calibrate/rest": Example(
        "Align inertial units with the model while the arm hangs vented and free.",
        "IDLE",
        {"aligned": ["imu"]},
    ),
    "record/start": Example(
        "Write every stream to a file on the service's host.",
        "IDLE",
        {"path": "/var/lib/softarm/recordings/pull.mcap"},
        {"name": "pull"},
    ),
    "record/stop": Example(
        "End the recording; only the lease holder who started one may end it.",
        "IDLE",
        {"path": "/var/lib/softarm/recordings/pull.mcap", "dropped": 0},
    ),
    "device/reconnect": Example(
        "Close a device and connect it again.", "IDLE", {"device": "valves"}, {"device": "valves"}
    ),
    "lease/acquire": Example(
        "Get the lease, or renew it by sending its token; the token is `applied.lease`.",
        "IDLE",
        {"lease": TOKEN, "remaining_s": 1.0},
    ),
    "lease/release": Example("Give the lease back; the arm vents.", "IDLE"),
}
"""Every verb of `VERBS`."""
