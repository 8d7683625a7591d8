"""Recordings of a small analytic arm, and faults to plant in them."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from softarm.estimator.recording import Recording
from softarm.estimator.rotations import exp, from_quaternions, to_quaternions
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.estimator.specimen.body import Marker

RATE = 20.0
LIMIT = 65e3
HEIGHTS = {"base": 0.0, "intermediate": 0.1405, "tip": 0.276}
BODIES = {
    "base": ((0.045, 0.0, 0.0), (-0.0225, 0.039, 0.004), (-0.0225, -0.030, -0.003)),
    "tip": ((0.032, 0.0, 0.003), (-0.017, 0.022, -0.002), (-0.015, -0.029, 0.0)),
}

Fault = Callable[[Recording], Recording]


def specimen() -> Specimen:
    """SoPrA with markers on its base and its tip."""
    markers = tuple(
        Marker(name=f"{section}{k}", section=section, offset_m=offset)
        for section, offsets in BODIES.items()
        for k, offset in enumerate(offsets)
    )
    return load_specimen("sopra").model_copy(update={"markers": markers})


def pressures(time: np.ndarray, seed: int) -> np.ndarray:
    """Ramp to random poses, hold each, and vent in between [Pa]."""
    rng = np.random.default_rng([seed, 1])
    points, times = [np.zeros(6), np.zeros(6)], [0.0, 2.0]
    while times[-1] < time[-1]:
        level = rng.uniform(0.2, 0.8, 6) * LIMIT * (rng.random(6) < 0.6)
        points += [level, level, np.zeros(6), np.zeros(6)]
        times += [times[-1] + step for step in np.cumsum([1.5, 4.0, 1.5, 2.0])]
    return np.column_stack([np.interp(time, times, column) for column in np.array(points).T])


def small_arm(
    seed: int = 0,
    seconds: float = 80.0,
    parts: tuple[str, ...] = ("bend", "frame", "marker"),
    flexibility: float = 0.9,
) -> Recording:
    """Record a constant-curvature arm with a lag, creep and a little softening.

    Args:
        seed: Of poses and noise.
        seconds: How long.
        parts: Kinds of sensors.
        flexibility: Bend of a segment by one chamber at its limit [rad].
    """
    rng = np.random.default_rng([seed, 2])
    time = np.arange(0.0, seconds, 1.0 / RATE)
    acting = pressures(time, seed)
    lagged, crept = _filtered(acting, 0.1), _filtered(acting, 8.0)
    effective = 0.93 * lagged + 0.07 * crept + 0.1 * lagged**2 / LIMIT
    azimuths = np.tile(np.arange(3) * 2.0 * np.pi / 3.0, 2)
    pushes = (
        -effective[:, :, None] * np.column_stack([np.cos(azimuths), np.sin(azimuths)]) * flexibility / LIMIT
    )
    bends = {"intermediate": pushes[:, :3].sum(axis=1), "tip": pushes[:, 3:].sum(axis=1)}
    columns: dict[str, np.ndarray] = {}
    for k in range(6):
        columns[f"pressure_cmd_{k}_pa"] = acting[:, k]
        columns[f"pressure_{k}_pa"] = acting[:, k] + rng.normal(0.0, 100.0, len(time))
    rotation, place, above = np.tile(np.eye(3), (len(time), 1, 1)), np.zeros((len(time), 3)), 0.0
    poses = {"base": (place, rotation)}
    for section in ("intermediate", "tip"):
        bend = bends[section]
        turn = exp(np.column_stack([-bend[:, 1], bend[:, 0], np.zeros(len(time))]))
        below = rotation @ turn
        length = HEIGHTS[section] - above
        place = place + 0.5 * length * (rotation[:, :, 2] + below[:, :, 2])
        rotation, above = below, HEIGHTS[section]
        poses[section] = (place, rotation)
    if "bend" in parts:
        for section, bend in bends.items():
            for k, axis in enumerate("xy"):
                columns[f"bend_{section}_{axis}_rad"] = bend[:, k] + rng.normal(0.0, 1e-3, len(time))
    for section, (where, how) in poses.items():
        if "frame" in parts:
            noise = exp(rng.normal(0.0, 5e-4, (len(time), 3)))
            pose = np.column_stack([where + rng.normal(0.0, 5e-5, where.shape), to_quaternions(how @ noise)])
            for name, values in zip(("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"), pose.T, strict=True):
                columns[f"frame_{section}_{name}"] = values
        if "marker" in parts and section in BODIES:
            for number, offset in enumerate(BODIES[section]):
                seen = where + how @ np.array(offset) + rng.normal(0.0, 1e-4, where.shape)
                for k, axis in enumerate("xyz"):
                    columns[f"marker_{section}{number}_{axis}_m"] = seen[:, k]
    return Recording("run", time, columns, {"specimen": "sopra"})


def scaled(start: str, end: str, factor: float, offset: float = 0.0) -> Fault:
    """Multiply the columns of some names, and add an offset."""
    return lambda recording: _with(
        recording,
        {
            n: v * factor + offset
            for n, v in recording.columns.items()
            if n.startswith(start) and n.endswith(end)
        },
    )


def exchanged(one: str, other: str) -> Fault:
    """Exchange the columns of two sensors."""

    def fault(recording: Recording) -> Recording:
        pairs = {**_named(recording, one, other), **_named(recording, other, one)}
        return _with(recording, pairs)

    return fault


def shifted(starts: tuple[str, ...], seconds: float) -> Fault:
    """Let some streams come late by some seconds; negative for early."""

    def fault(recording: Recording) -> Recording:
        rows = round(seconds * RATE)
        moved = {}
        for name, values in recording.columns.items():
            if name.startswith(starts):
                rolled = np.roll(values, rows)
                rolled[:rows] = np.nan if rows > 0 else rolled[:rows]
                if rows < 0:
                    rolled[rows:] = np.nan
                moved[name] = rolled
        return _with(recording, moved)

    return fault


def touched(begin: float, seconds: float = 3.0, angle: float = 0.25) -> Fault:
    """Push the tip aside for some seconds, as a hand does."""

    def fault(recording: Recording) -> Recording:
        time = recording.time
        push = angle * np.clip(np.minimum(time - begin, begin + seconds - time) / 0.4, 0.0, 1.0)
        return _moved(recording, push)

    return fault


def thrown(seconds: float = 3.0, angle: float = 0.4) -> Fault:
    """Begin with a swing of 2 Hz that nothing in the pressures causes."""
    return lambda recording: _moved(
        recording, angle * np.sin(4.0 * np.pi * recording.time) * np.clip(seconds - recording.time, 0.0, 1.0)
    )


def lost_and_found(at: float = 50.5, away: float = 0.04) -> Fault:
    """Lose the tip's bodies for a second and find them elsewhere."""

    def fault(recording: Recording) -> Recording:
        time, moved = recording.time, {}
        for name, values in recording.columns.items():
            if name.startswith(("bend_tip", "frame_tip", "marker_tip")):
                step = away if name.endswith("_x_m") else 5.0 * away if name.endswith("_x_rad") else 0.0
                moved[name] = np.where(
                    (time > at) & (time < at + 1.0), np.nan, values + step * (time >= at + 1.0)
                )
        return _with(recording, moved)

    return fault


def rotated(rotation: tuple[float, float, float]) -> Fault:
    """Turn the laboratory by a rotation vector [rad]."""

    def fault(recording: Recording) -> Recording:
        (matrix,) = exp(np.array([rotation]))
        moved = {}
        for name in recording.markers:
            place = recording.marker(name) @ matrix.T
            moved |= {f"marker_{name}_{axis}_m": place[:, k] for k, axis in enumerate("xyz")}
        for name in recording.frames:
            pose = recording.pose(name)
            place, quaternion = pose[:, :3] @ matrix.T, to_quaternions(matrix @ from_quaternions(pose[:, 3:]))
            moved |= {f"frame_{name}_{axis}_m": place[:, k] for k, axis in enumerate("xyz")}
            moved |= {f"frame_{name}_q{letter}": quaternion[:, k] for k, letter in enumerate("wxyz")}
        return _with(recording, moved)

    return fault


def base_unread(recording: Recording) -> Recording:
    """Lose every reading of the base."""
    base = [n for n in recording.columns if n.startswith(("marker_base", "frame_base"))]
    return _with(recording, {n: np.full(len(recording.time), np.nan) for n in base})


def base_of_zeros(recording: Recording) -> Recording:
    """Write zeros for the base's frame, as many systems do for a body that was never found."""
    return scaled("frame_base", "", 0.0)(recording)


def left_handed(axis: int) -> Fault:
    """Mirror positions along an axis, and orientations with them: M p and M R M."""

    def fault(recording: Recording) -> Recording:
        mirror = np.diag([-1.0 if k == axis else 1.0 for k in range(3)])
        moved = dict(scaled("", f"_{'xyz'[axis]}_m", -1.0)(recording).columns)
        for name in recording.frames:
            quaternions = to_quaternions(mirror @ from_quaternions(recording.pose(name)[:, 3:]) @ mirror)
            moved |= {f"frame_{name}_q{letter}": quaternions[:, k] for k, letter in enumerate("wxyz")}
        return _with(recording, moved)

    return fault


def only(*kinds: str) -> Fault:
    """Keep the pressures and some kinds of sensors."""
    return lambda recording: replace(
        recording, columns={n: v for n, v in recording.columns.items() if n.startswith(("pressure", *kinds))}
    )


def body_turned(section: str, rotation: tuple[float, float, float]) -> Fault:
    """Define the body of a section by axes that are turned by a rotation vector [rad]."""

    def fault(recording: Recording) -> Recording:
        turns = from_quaternions(recording.pose(section)[:, 3:]) @ exp(np.array(rotation))
        named = zip("wxyz", to_quaternions(turns).T, strict=True)
        return _with(recording, {f"frame_{section}_q{letter}": values for letter, values in named})

    return fault


def scalar_last(recording: Recording) -> Recording:
    """Write quaternions as (x, y, z, w)."""
    moved = {}
    for name in recording.frames:
        for letter, source in zip("wxyz", "xyzw", strict=True):
            moved[f"frame_{name}_q{letter}"] = recording.columns[f"frame_{name}_q{source}"]
    return _with(recording, moved)


def without_base(recording: Recording) -> Recording:
    """Leave out all that shows the base."""
    kept = {n: v for n, v in recording.columns.items() if not n.startswith(("marker_base", "frame_base"))}
    return replace(recording, columns=kept)


def three_chambers(recording: Recording) -> Recording:
    """Leave out the lower segment's pressures, and what names the specimen."""
    lost = tuple(f"pressure_{cmd}{k}_pa" for k in (3, 4, 5) for cmd in ("", "cmd_"))
    return replace(recording, columns={n: v for n, v in recording.columns.items() if n not in lost}, info={})


def in_milliseconds(recording: Recording) -> Recording:
    """Write the time in milliseconds."""
    return replace(recording, time=1e3 * recording.time)


def stated(**info: object) -> Fault:
    """State something in ``recording.toml``."""
    return lambda recording: replace(recording, info={**recording.info, **info})


def zeros_where_lost(recording: Recording) -> Recording:
    """Lose the markers and frames of the tip for two seconds and write zeros for them, as many systems do."""
    lost = (recording.time >= 30.0) & (recording.time < 32.0)
    names = [n for n in recording.columns if n.startswith(("frame_tip", "marker_tip"))]
    return _with(recording, {n: np.where(lost, 0.0, recording.columns[n]) for n in names})


def placeholders(number: float, starts: tuple[str, ...], ends: tuple[str, ...] = ("",)) -> Fault:
    """Write a number into a tenth of the readings of some columns, as some systems do for a lost body."""

    def fault(recording: Recording) -> Recording:
        lost = (10.0 * recording.time).astype(int) % 10 == 3
        names = [n for n in recording.columns if n.startswith(starts) and n.endswith(ends)]
        return _with(recording, {n: np.where(lost, number, recording.columns[n]) for n in names})

    return fault


def both(first: Fault, second: Fault) -> Fault:
    """Plant two faults."""
    return lambda recording: second(first(recording))


def _moved(recording: Recording, push: np.ndarray) -> Recording:
    share = {"bend_tip_x_rad": 1.0, "bend_intermediate_x_rad": 0.6, "frame_tip_x_m": 0.16}
    share |= {"frame_intermediate_x_m": 0.04, **{f"marker_tip{k}_x_m": 0.16 for k in range(3)}}
    return _with(
        recording, {n: recording.columns[n] + s * push for n, s in share.items() if n in recording.columns}
    )


def _with(recording: Recording, columns: Mapping[str, np.ndarray]) -> Recording:
    return replace(recording, columns={**recording.columns, **columns})


def _named(recording: Recording, one: str, other: str) -> dict[str, np.ndarray]:
    return {
        f"{other}_{name.removeprefix(f'{one}_')}": values
        for name, values in recording.columns.items()
        if name.startswith(f"{one}_")
    }


def _filtered(values: np.ndarray, lag: float) -> np.ndarray:
    keep, out, state = np.exp(-1.0 / (RATE * lag)), np.empty_like(values), values[0]
    for row, value in enumerate(values):
        state = keep * state + (1.0 - keep) * value
        out[row] = state
    return out
