"""Diagnoses as the pipeline returns them: of each verdict, and of an arm without chambers."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from softarm.analysis.diagnosis.html import page
from softarm.estimator.diagnosis.result import (
    Baseline,
    Cell,
    ChannelError,
    DetectionLimit,
    Diagnosis,
    Evidence,
    Exposure,
    Finding,
    Heldout,
    InnovationTest,
    LocationMap,
    NotTestable,
    Quantity,
    Rejected,
    Rival,
    Stretch,
    Trace,
    Unexplained,
)
from softarm.estimator.specimen import load_specimen
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
        evidence=Evidence(
            206.0, 3.2, 1.1, (0.55, 0.71), 0.005, {"bend_tip.x": ChannelError("rad", 0.022, 0.008)}
        ),
        confusable_with=(Rival("hysteresis", Place(segment="lower"), "ramps at two rates", 1.5),),
        rejected=(Rejected("thermal_drift", Place(), 60.0), Rejected("line_lag", Place(chamber=3), 190.0)),
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
        heldout=Heldout(
            3.2,
            1.1,
            (0.55, 0.71),
            "every third run",
            {"bend_tip.x": ChannelError("rad", 0.022, 0.008)},
            InnovationTest(
                *({"bend_tip.x": value} for value in (1.21, 0.42, 0.003, 4.1, 0.93)),
            ),
        ),
        unexplained=Unexplained(
            1.1,
            Place(segment="upper"),
            "pose",
            over_nominal=1.9,
            worst=Stretch("run_04", "bend_tip.x", "rad", 12.0, 15.0, 0.02),
        ),
        not_testable=(NotTestable("mullins_softening", "cycles of growing amplitude"),),
        detection_limits=(DetectionLimit("tip_payload", Place(section="tip"), "mass", 0.012, "kg"),),
        notes=("12 gaps of up to 0.14 s.",),
        traces=(trace(), trace("bend_tip.y")),
        seconds=81.0,
    )


def _told(whole: Diagnosis, before: float, after: float, over_nominal: float | None) -> Diagnosis:
    """Change how well a diagnosis predicts unseen data, every number that depends on it included."""
    errors = {"bend_tip.x": ChannelError("rad", 0.01 * before, 0.01 * after)}
    heldout = replace(whole.heldout, before=before, after=after, channels=errors)
    left = replace(whole.unexplained, normalised_rms=after, over_nominal=over_nominal)
    return replace(whole, heldout=heldout, unexplained=left)


def consistent() -> Diagnosis:
    """An arm that has not changed, with a model that is off by more than the noise."""
    calm = replace(diagnosis(), verdict="consistent", findings=(), traces=(trace(),))
    return _told(calm, 4.0, 4.0, 1.05)


def explained(after: float = 1.1) -> Diagnosis:
    """One finding that leaves a given multiple of the noise, of an error of 40 times the noise."""
    evidence = replace(finding().evidence, heldout_before=40.0, heldout_after=after)
    found = replace(finding(), evidence=evidence)
    return _told(replace(diagnosis(), verdict="explained", findings=(found,)), 40.0, after, 0.9)


def unexplained() -> Diagnosis:
    """A mismatch that nothing explains."""
    missing = Finding(
        effect="unknown",
        where=Place(segment="lower"),
        when="pose",
        statement="No known effect explains it.",
        parameters={},
        evidence=Evidence(0.0, 5.0, 5.0, (0.0, 0.0), 0.01),
    )
    return _told(replace(diagnosis(), verdict="unexplained", findings=(missing,)), 5.0, 5.0, 3.0)


def without_chambers() -> Diagnosis:
    """A beam with a load that may be a mass or a force."""
    load = Finding(
        effect="tip_payload",
        where=Place(section="tip"),
        when="constant",
        statement="The tip section carries a mass that is not in the model: 52 g.",
        parameters={"mass": Quantity(0.052, 0.001, "kg")},
        evidence=Evidence(900.0, 236.0, 29.8, (0.873, 0.874), float("nan")),
        confusable_with=(Rival("external_force", Place(section="tip"), "the mount turned", 0.4),),
    )
    beam = replace(diagnosis(), specimen="beam", verdict="explained", findings=(load,), not_testable=())
    return _told(beam, 236.0, 29.8, 0.31)


@cache
def page_of(made: Callable[[], Diagnosis]) -> str:
    """Return the page of a diagnosis; drawing its figures takes a second."""
    return page(made(), load_specimen("beam" if made is without_chambers else "sopra"))
