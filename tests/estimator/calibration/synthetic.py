"""Recordings of a toy arm whose calibration is known."""

import numpy as np
from toy import toy

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import section_forces
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import to_quaternions
from softarm.estimator.sensing import Registration
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import (
    BendCalibration,
    Calibration,
    ChamberCalibration,
    FrameCalibration,
    Specimen,
    Value,
    load_specimen,
)

GAINS = np.array([1.1, 0.95, 0.95, 0.9, 1.05, 1.05])
SCALES = {"upper": 0.7, "lower": 1.4}
HOLD = 2.0  # s


def bend(section: str, rotation: float, bias: tuple[float, float], mirrored: bool) -> BendCalibration:
    return BendCalibration(
        section=section,
        rotation_rad=Value(value=rotation),
        mirrored=mirrored,
        bias_x_rad=Value(value=bias[0]),
        bias_y_rad=Value(value=bias[1]),
    )


def true_specimen(mirrored: bool = True) -> Specimen:
    calibration = Calibration(
        modulus_scale={name: Value(value=scale) for name, scale in SCALES.items()},
        chambers=tuple(ChamberCalibration(index=k, gain=Value(value=GAINS[k])) for k in range(6)),
        bends=(
            bend("intermediate", 2.0, (0.1, -0.05), mirrored),
            bend("tip", -1.0, (-0.08, 0.03), mirrored),
        ),
        frames=(
            FrameCalibration(
                section="tip", misalignment_rad=(0.05, -0.04, 0.3), offset_m=(0.005, 0.0, -0.01)
            ),
        ),
    )
    return load_specimen("sopra").model_copy(update={"calibration": calibration})


def staircase(
    duration: float, rate: float, chambers: tuple[int, ...], seed: int = 1
) -> tuple[Floats, Floats]:
    """Draw pressures [Pa] that are held and then jump, shape (samples, 6)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, duration, 1 / rate)
    pressures = np.zeros((len(time), 6))
    steps = (time // HOLD).astype(int)
    for chamber in chambers:
        pressures[:, chamber] = rng.uniform(0, 5e4, steps.max() + 1)[steps]
    return time, pressures


def record(
    duration: float = 40.0,
    rate: float = 20.0,
    chambers: tuple[int, ...] = (0, 1, 2, 3, 4, 5),
    noise: float = 2e-3,
    lag: float = 0.0,
    kinds: tuple[str, ...] = ("bend",),
    mirrored: bool = True,
    seed: int = 1,
) -> Recording:
    """Record the toy arm with the true calibration."""
    rng = np.random.default_rng(seed + 100)
    specimen = true_specimen(mirrored)
    time, pressures = staircase(duration, rate, chambers, seed)
    model = toy().with_scales(SCALES)
    late = np.column_stack([np.interp(time - lag, time, column) for column in pressures.T])
    frames = model.batch(late * GAINS, np.tile(model.scales, (len(time), 1)), np.zeros((len(time), 0)))
    make = SpecimenSensors(specimen, model.sections, Registration())
    columns = {f"pressure_{k}_pa": pressures[:, k] + rng.normal(0, 100, len(time)) for k in chambers}
    if "bend" in kinds:
        for section in ("intermediate", "tip"):
            angles = make.bend(section).predict(frames) + rng.normal(0, noise, (len(time), 2))
            columns |= {f"bend_{section}_{axis}_rad": angles[:, i] for i, axis in enumerate("xy")}
    if "frame" in kinds:
        pose = make.pose("tip").predict(frames)
        pose[:, :3] += rng.normal(0, 2e-4, (len(time), 3))
        names = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
        columns |= {f"frame_tip_{name}": pose[:, i] for i, name in enumerate(names)}
        turned = to_quaternions(np.eye(3)[None])[0]
        columns |= {
            f"frame_base_{name}": np.full(len(time), ([0.0] * 3 + list(turned))[i])
            for i, name in enumerate(names)
        }
    return Recording("toy", time, columns, {"specimen": "sopra"})


def record_pulls(stiffer: tuple[float, ...], seconds: float, seed: int = 3) -> Recording:
    """Record the vented toy arm, pulled along x at the tip to another force every two seconds.

    Each pull begins slack, and meets an arm that is stiffer by a factor of its own.
    """
    rng = np.random.default_rng(seed)
    specimen = true_specimen()
    time = np.arange(0, len(stiffer) * seconds, 0.05)
    steps = (time // HOLD).astype(int)
    force = np.where(time % seconds < HOLD, 0.0, rng.uniform(0.1, 1.0, steps.max() + 1)[steps])
    loads = section_forces(specimen)
    pulls = np.array([load.name == "tip_x" for load in loads]) * force[:, None]
    scales = np.array(stiffer)[(time // seconds).astype(int)][:, None] * list(SCALES.values())
    model = toy(loads)
    frames = model.batch(np.zeros((len(time), 6)), scales, pulls)
    make = SpecimenSensors(specimen, model.sections, Registration())
    columns = {f"pressure_{k}_pa": rng.normal(0, 100, len(time)) for k in range(6)} | {"gauge_tip_n": force}
    for section in ("intermediate", "tip"):
        angles = make.bend(section).predict(frames) + rng.normal(0, 1e-3, (len(time), 2))
        columns |= {f"bend_{section}_{axis}_rad": angles[:, i] for i, axis in enumerate("xy")}
    return Recording("pulls", time, columns, {"specimen": "sopra", "gauge_direction": [1.0, 0.0, 0.0]})
