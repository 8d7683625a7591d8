"""The figures of README: one sentence each, with numbers out of stored output."""

from acceptance.measured import Figure

FIGURES = (
    Figure(
        "Faults of devices under pressure: {cases} cases, {wrong} with a wrong outcome. In the "
        "{vents} that must vent the arm, the slowest took {slowest} ms (aim: 200 ms).",
        "safety",
        {
            "cases": ("Faults of every device", {"device": "all"}, "faults"),
            "wrong": ("Faults of every device", {"device": "all"}, "wrong_outcomes"),
            "vents": ("Faults of every device", {"device": "all"}, "vent"),
            "slowest": ("Faults of every device", {"device": "all"}, "slowest_vent_ms"),
        },
    ),
    Figure(
        "Thirty minutes of device faults and stalled clients: {answered} commands answered, {lost} not "
        "answered in time, slowest reply {slowest} ms (aim: 100 ms); {skipped} % of control ticks skipped "
        "(aim: 1 %).",
        "soak",
        {
            "answered": ("Soak", {"what": "commands_answered"}, "value"),
            "lost": ("Soak", {"what": "replies_lost"}, "value"),
            "slowest": ("Soak", {"what": "slowest_reply_ms"}, "value"),
            "skipped": ("Soak", {"what": "ticks_skipped_percent"}, "value"),
        },
    ),
    Figure(
        "Force at the tip live, as the demo prints it on its simulated arm: {still} % of range without "
        "pressure and {pressurised} % under pressure (aims: 0.5 and 0.6 %). Share of its errors within two "
        "standard deviations: {still_inside} and {pressurised_inside} (aim: 0.90 to 0.98).",
        "demo",
        {
            name + suffix: ("External force", {"condition": condition}, column)
            for name, condition in (("still", "not pressurised"), ("pressurised", "pressurised"))
            for suffix, column in (("", "mean_percent"), ("_inside", "inside_2_std"))
        },
    ),
)
