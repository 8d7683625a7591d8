"""A diagnosis as the pipeline would give it, with every part filled."""

import numpy as np

from softarm.estimator.diagnosis.result import (
    Baseline,
    Cell,
    Diagnosis,
    Evidence,
    Exposure,
    Finding,
    Heldout,
    LocationMap,
    NotTestable,
    Quantity,
    Rejected,
    Rival,
    Trace,
    Unexplained,
)
from softarm.estimator.specimen.physics import Place

TIME = np.linspace(0.0, 60.0, 900)


def trace(channel: str = "bend_tip.x") -> Trace:
    before = 0.5 * np.sin(0.2 * TIME)
    measured = before + 0.05 * (1.0 - np.exp(-TIME / 8.0))
    measured[100:120] = np.nan
    return Trace("run_03", channel, "rad", TIME, measured, before, measured - 0.001, TIME > 40.0)


def finding() -> Finding:
    values = np.linspace(0.0, 50e3, 900)
    return Finding(
        effect="viscoelastic_creep",
        where=Place(segment="lower"),
        when="time since a change",
        statement="The material of segment lower creeps <by 15 %> & comes back.",
        parameters={"strength": Quantity(0.152, 0.01, "1"), "time_constant": Quantity(8.1, 0.4, "s")},
        evidence=Evidence(412.0, 3.2, 1.1, (0.55, 0.71), 0.005),
        confusable_with=(Rival("hysteresis", Place(segment="lower"), "ramps at two rates", 3.0),),
        rejected=(Rejected("thermal_drift", Place(), 120.0), Rejected("line_lag", Place(chamber=3), 380.0)),
        exposure=Exposure(
            "pressure of chamber 3", "Pa", "bend_tip.x", "rad", values, values * 1e-6, values * 0.0
        ),
    )


def diagnosis() -> Diagnosis:
    cells = (
        Cell("segment", "lower", "x", "time since a change", 0.004, "N m", 0.81, 0.002),
        Cell("chamber", "3", "pressure", "pressure level", 900.0, "Pa", 0.30, 0.02),
        Cell("sensor", "bend_tip", "x", "constant", 0.01, "rad", 0.12, 0.4),
        Cell("base", "base", "x", "pose", 0.01, "rad", 0.05, 0.7),
    )
    return Diagnosis(
        specimen="sopra",
        recordings=("run_03", "run_04"),
        nominal=("nominal_00",),
        verdict="partly_explained",
        baseline=Baseline({"bend_tip.x": 0.02}, {"bend_tip.x": 0.004}, {"bend_tip.x": "rad"}, 4.1),
        map=LocationMap(cells),
        findings=(finding(),),
        heldout=Heldout(3.2, 1.1, (0.55, 0.71), "Every third run is held out."),
        unexplained=Unexplained(1.1, Place(segment="upper"), "pose"),
        not_testable=(NotTestable("mullins_softening", "cycles of growing amplitude"),),
        notes=("12 gaps of up to 0.14 s.",),
        traces=(trace(), trace("bend_tip.y")),
        seconds=81.0,
    )
