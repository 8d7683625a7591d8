"""Effects, fits and judgements as tests of the choice make them."""

from typing import Any

import numpy as np

from softarm.estimator.diagnosis.candidates import (
    Accepted,
    Candidate,
    ChosenEffects,
)
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.judge import (
    Judgement,
)
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place

SAMPLES, RUNS = 60, 5


TIP = Place(section="tip")


def hypothesis(name: str, place: Place = TIP) -> Hypothesis:
    return Hypothesis(EFFECTS[name], place)


def fit_of(name: str, *theta: float, deviation: float = 1e-3, gain: float = 100.0) -> Fit:
    scales = np.array([parameter.scale for parameter in EFFECTS[name].parameters])
    covariance = np.diag((deviation / scales) ** 2)
    return Fit((hypothesis(name),), (np.array(theta),), covariance, gain)


def candidate(fit: Fit, delta_bic: float, number: int = 0) -> Candidate:
    return Candidate(number, fit, delta_bic)


def judgement(**changes: Any) -> Judgement:
    usual: dict[str, Any] = {
        "before": 3.0, "after": 1.0, "gain_ci95": (0.3, 0.7), "share": 0.8, "change": 2.0,
        "search_p": 0.0, "delta_bic": 30.0,
    }  # fmt: skip
    return Judgement(**(usual | changes))


def chosen(*fits: Fit, gain: float = 100.0) -> ChosenEffects:
    if not fits:
        return ChosenEffects((), None, 1.0, None)
    joint = fits[0]
    for fit in fits[1:]:
        joint = joint.joined(fit)
    accepted = tuple(Accepted(candidate(fit, gain), judgement(), ()) for fit in fits)
    return ChosenEffects(accepted, joint, 0.0, None)
