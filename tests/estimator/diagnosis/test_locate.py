"""The map of a mismatch counts every recording, whatever its sensors are."""

from dataclasses import replace

import numpy as np

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis.diagnose import assemble, begin
from softarm.estimator.diagnosis.locate import locate
from softarm.estimator.diagnosis.result import LocationMap
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, session

OFFSET = (("sensor_bias", Place(sensor="bend_intermediate"), (0.1, 0.0)),)


def without(run: Session, sensor: str) -> Session:
    """Return a recording by the other sensors alone."""
    rows = np.concatenate([np.full(len(m.units), m.name != sensor) for m in run.suite.measurements])
    return replace(
        run,
        suite=SensorSuite(tuple(m for m in run.suite.measurements if m.name != sensor)),
        readings=run.readings[:, rows],
        sigma=run.sigma[rows],
    )


def mapped(runs: list[Session]) -> LocationMap:
    sessions = [session(f"nominal_{k}", k, nominal=True) for k in range(2)] + runs
    search = begin(assemble(model(), sessions, Inline(), ("sensor_bias",)).evidence, fast=False)
    return locate(search.left(None), np.random.default_rng(0))


def test_recordings_with_other_sensors_count() -> None:
    """The offset is in recordings that come after one that lacks its sensor."""
    runs = [session(f"run_{k}", 10 + k, OFFSET) for k in range(4)]
    best = mapped([without(runs[0], "bend_intermediate"), *runs[1:]]).best
    assert best is not None
    assert (best.kind, best.name, best.regime) == ("sensor", "bend_intermediate", "constant")
    assert 0.9 < best.share <= 1.0
