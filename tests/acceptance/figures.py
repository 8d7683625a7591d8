"""The figures of README: one sentence each, with numbers out of stored output."""

from acceptance.measured import Figure

FIGURES = (
    Figure(
        "Faults of devices under pressure: {cases} cases, {wrong} with a wrong outcome. In the "
        "{vents} that must vent the arm, the slowest took {slowest} ms (aim: 200 ms).",
        "safety",
        {
            "cases": ("Faults of every device", {"device": "all"}, "faults"),
            "wrong": ("Faults of every device", {"device": "all"}, "not_as_stated"),
            "vents": ("Faults of every device", {"device": "all"}, "vent"),
            "slowest": ("Faults of every device", {"device": "all"}, "slowest_vent_ms"),
        },
    ),
    Figure(
        "Thirty minutes of faults, stalled clients and commands: {lost} replies lost, the slowest took "
        "{slowest} ms (aim: 100 ms); {skipped} % of control ticks skipped (aim: 1 %).",
        "soak",
        {
            "lost": ("Soak", {"what": "replies_lost"}, "value"),
            "slowest": ("Soak", {"what": "slowest_reply_ms"}, "value"),
            "skipped": ("Soak", {"what": "ticks_skipped_percent"}, "value"),
        },
    ),
)
