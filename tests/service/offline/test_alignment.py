"""A specimen is fitted to a recording that it does not predict; others are left alone."""

import numpy as np
import pytest

from softarm.analysis.offline.alignment import aligned
from softarm.common.rods import rod_for
from softarm.estimator.recording import Recording
from softarm.estimator.response import BatchInputs
from softarm.estimator.specimen import Calibration, Specimen, load_specimen

TURN = np.radians(100.0)


def record(turn: float, mirrored: bool) -> Recording:
    """Let the rod of the arm record its bends with turned axes."""
    sopra = load_specimen("sopra")
    rod = rod_for(sopra).with_loads(())
    time = np.arange(0.0, 40.0, 0.1)
    held = np.random.default_rng(3).uniform(0.0, 4e4, (len(time) // 20, 6))
    pressures = np.repeat(held, 20, axis=0)
    inputs = BatchInputs(pressures, np.zeros((len(time), 0)), np.array(sopra.gravity_m_s2))
    frames = rod.evaluate(inputs).frames
    columns = {f"pressure_{k}_pa": pressures[:, k] for k in range(6)}
    for number, name in ((1, "intermediate"), (2, "tip")):
        axis = np.einsum("tji,tj->ti", frames.rotations[:, number - 1], frames.rotations[:, number, :, 2])
        size = np.arccos(np.clip(axis[:, 2], -1.0, 1.0)) / np.maximum(np.hypot(axis[:, 0], axis[:, 1]), 1e-9)
        bend = (axis[:, 0] + 1j * axis[:, 1] * (-1.0 if mirrored else 1.0)) * size * np.exp(1j * turn)
        columns[f"bend_{name}_x_rad"], columns[f"bend_{name}_y_rad"] = bend.real, bend.imag
    return Recording("run", time, columns, {"pressure_source": "measured"})


def bare() -> Specimen:
    return load_specimen("sopra").model_copy(update={"calibration": Calibration()})


@pytest.mark.parametrize("mirrored", [False, True])
def test_turned_axes_are_found(mirrored: bool) -> None:
    found, told = aligned(bare(), record(TURN, mirrored))
    assert "sopra as described does not predict bend_intermediate and bend_tip" in told
    for bend in found.calibration.bends:
        assert bend.mirrored is mirrored
        assert bend.rotation_rad.value == pytest.approx(TURN, abs=0.02)
    for scale in found.calibration.modulus_scale.values():
        assert scale.value == pytest.approx(1.0, abs=0.05)


def test_a_specimen_that_predicts_the_recording_or_was_calibrated_stays() -> None:
    plain = bare()
    assert aligned(plain, record(0.0, mirrored=False)) == (plain, "")
    turned = record(TURN, mirrored=False)
    known = plain.model_copy(update={"calibration": Calibration(recordings=("another",))})
    assert aligned(known, turned) == (known, "")
    assert aligned(plain, turned.window(turned.time < 10.0)) == (plain, "")
