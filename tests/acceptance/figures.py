"""The figures of README: one sentence each, with numbers out of stored output."""

from acceptance.measured import Figure

FIGURES = (
    Figure(
        "Tip position predicted from pressures alone: {position} mm mean error over three simulated arms "
        "(paper: 36.5 mm on its real arm).",
        "experiments",
        {"position": ("Aims", {"experiment": "validation", "quantity": "position [mm]"}, "mean")},
    ),
    Figure(
        "External force at the tip, recorded, mean over three simulated arms: {rest} % of range without "
        "pressure and {pressurised} % under pressure (paper: 1.05 % and 1.2 %).",
        "experiments",
        {
            "rest": ("Aims", {"quantity": "not pressurised [% of range]"}, "mean"),
            "pressurised": ("Aims", {"quantity": "pressurised [% of range]"}, "mean"),
        },
    ),
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
)
