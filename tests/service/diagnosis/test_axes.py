"""Axes of bends that nobody knows are found before a diagnosis, or the recordings refused."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.analysis.diagnosis import run
from softarm.estimator.calibration import CalibrationRefusedError, MotionNotPredictedError, NotImprovedError
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import load_specimen


def with_refusal(monkeypatch: pytest.MonkeyPatch, refusal: CalibrationRefusedError) -> tuple[Any, str]:
    """Look for axes where the calibration is refused."""

    def refuse(*_: object) -> None:
        raise refusal

    monkeypatch.setattr(run, "calibrate", refuse)
    monkeypatch.setattr(run, "arrange", lambda *_: None)
    admitted = SimpleNamespace(nominal=(Recording("turned", np.arange(0.0, 40.0, 0.1), {}),))
    rod = SimpleNamespace(with_loads=lambda _: None)
    return run.with_axes(load_specimen("sopra"), cast("Any", admitted), (), cast("Any", rod))


def test_recordings_whose_motion_no_axes_predict_are_refused(monkeypatch):
    refusal = MotionNotPredictedError("calibration", "the model errs by 24 degrees", "look again")
    with pytest.raises(InputError, match=r"turned: however .* lie, the model errs by 24 degrees; check"):
        with_refusal(monkeypatch, refusal)


def test_axes_are_found_alone_where_nothing_else_is_calibrated(monkeypatch):
    turned = load_specimen("single_segment")
    monkeypatch.setattr(run, "with_bend_axes", lambda *_: turned)
    specimen, words = with_refusal(monkeypatch, NotImprovedError("calibration", "the error grows", "go on"))
    assert specimen is turned
    assert words.endswith("nothing else was calibrated so, since the error grows.")


def test_axes_stay_as_described_where_too_little_moves(monkeypatch):
    specimen, words = with_refusal(monkeypatch, CalibrationRefusedError("calibration", "rests", "move it"))
    assert specimen == load_specimen("sopra")
    assert "stay as described" in words
