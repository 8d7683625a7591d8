"""Units of lengths, by the size of the arm, which is that of the specimen.

Frames and markers each have a unit of their own. So has a single one of them that lies far from all others.
What the specimen does not describe, such as a marker on the hook of a gauge, shares the unit of the others.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.hypotheses import BestExplanation, Explanation, choose
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen

LENGTHS = {
    "metres": (1.0, 0.0),
    "millimetres": (1e-3, -3.0),
    "centimetres": (1e-2, -4.0),
    "inches": (0.0254, -6.0),
}
SIZE_SPREAD = 0.25
"""Spread of the logarithm of a size: bodies lie elsewhere on the arm than they were drawn."""
FAR = 20.0
"""Times the usual distance from the middle of the arm from which a body is in another unit than the others:
inches beside metres make 39."""
PLACE_SPREAD = 0.5
"""Spread of the logarithm of the distance of one body from the middle of an arm that bends."""
REACH = 5.0
"""Longest distance from the arm [m] of what the specimen does not describe."""

Bodies = Mapping[str, tuple[Floats, Floats]]
"""Names of bodies as their columns begin, with their usual place as recorded and that of the specimen [m]."""


def correct_lengths(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring positions to metres: markers and frames each have a size that the specimen knows."""
    found: list[RecordingFault] = []
    units: list[str] = []
    corrected = recording
    for kind, bodies in (("frame", _frames(recording, specimen)), ("marker", _markers(recording, specimen))):
        far = _far(bodies)
        near = {name: places for name, places in bodies.items() if name not in far}
        sizes = _sizes(recording, near, kind, specimen)
        if sizes is None:
            continue
        unit, fault = _common_unit(recording, tuple(near), kind, sizes)
        found += [fault] if fault else []
        if fault is None or fault.corrected:
            units.append(unit)
            corrected = _scaled(corrected, tuple(near), LENGTHS[unit][0])
            for name in far:
                corrected, more = _single(corrected, specimen, name, bodies, LENGTHS[unit][0])
                found += more
    if all(fault.corrected for fault in found):
        corrected, others = _others(corrected, specimen, units)
        found += others
    return corrected, tuple(found)


def _common_unit(
    recording: Recording, bodies: tuple[str, ...], kind: str, sizes: tuple[float, float, float]
) -> tuple[str, RecordingFault | None]:
    size, expected, spread = sizes
    choice = _choice(size, expected, spread)
    unit = choice.best.what
    if unit == "metres":
        return unit, None
    columns = tuple(name for body in bodies for name in _positions(body))
    what = f"the {kind}s lie {size:.4g} apart, the specimen's {expected:.4g} m: they are in {unit}"
    cure = "converted for this run"
    if not choice.unambiguous:
        cure = f"convert them to metres (odds only {choice.odds:.0f} against {choice.second.what})"
    corrected = choice.unambiguous
    return unit, RecordingFault(recording.name, "unit", columns, what, cure, corrected, choice.odds)


def _choice(size: float, expected: float, spread: float) -> BestExplanation[str]:
    return choose(
        [
            Explanation(unit, prior - 0.5 * (np.log(max(size * factor, 1e-12) / expected) / spread) ** 2)
            for unit, (factor, prior) in LENGTHS.items()
        ]
    )


def _far(bodies: Bodies) -> tuple[str, ...]:
    """List the bodies, fewer than half, that lie far from all others."""
    if len(bodies) < 3:
        return ()
    places = np.array([place for place, _ in bodies.values()])
    away = np.linalg.norm(places - np.median(places, axis=0), axis=1)
    far = tuple(name for name, one in zip(bodies, away, strict=True) if one > FAR * np.median(away))
    return far if 2 * len(far) < len(bodies) else ()


def _single(
    recording: Recording, specimen: Specimen, name: str, bodies: Bodies, factor: float
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring one body that lies far from the others to metres, where one unit puts it in its place.

    Args:
        recording: With the others in metres.
        specimen: The robot.
        name: Which body.
        bodies: All of its kind, as recorded.
        factor: From the unit of the others to metres.
    """
    place, rest = bodies[name]
    middle = factor * np.median([one for one, _ in bodies.values()], axis=0)
    expected = float(np.linalg.norm(rest - np.median([one for _, one in bodies.values()], axis=0)))
    away = {unit: float(np.linalg.norm(place * one - middle)) for unit, (one, _) in LENGTHS.items()}
    choice: BestExplanation[str] = choose(
        [
            Explanation(
                unit, LENGTHS[unit][1] - 0.5 * (np.log(max(one, 1e-3) / expected) / PLACE_SPREAD) ** 2
            )
            for unit, one in away.items()
        ]
    )
    unit = choice.best.what
    what = (
        f"{name} lies {away['metres']:.4g} m from the middle of the others, in the specimen {expected:.4g} m"
    )
    if away[unit] > 2.0 * specimen.length_m:  # in no unit is it a part of the arm
        if away["metres"] < REACH:
            return recording, ()
        unit, cure = "", "leave its cells empty where it was not seen, or convert it to metres"
    elif choice.unambiguous:
        what, cure = f"{what}: it is in {unit}", "converted for this run"
    else:
        what += f": it is in {unit} or {choice.second.what}"
        cure = f"convert it to metres (odds only {choice.odds:.0f})"
    corrected = bool(unit) and choice.unambiguous
    fault = RecordingFault(recording.name, "unit", _positions(name), what, cure, corrected, choice.odds)
    return _scaled(recording, (name,), LENGTHS[unit][0]) if corrected else recording, (fault,)


def _others(
    recording: Recording, specimen: Specimen, units: list[str]
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring markers that the specimen does not describe to the unit that frames or markers were in."""
    described = {**_frames(recording, specimen), **_markers(recording, specimen)}
    if len(_markers(recording, specimen)) < 2:
        described = dict(_frames(recording, specimen))
    if not described:
        return recording, ()
    middle = np.median([place for place, _ in described.values()], axis=0)
    corrected, found = recording, []
    for name in (f"marker_{one}" for one in recording.markers if f"marker_{one}" not in described):
        place = _usual(recording.stack(_positions(name)))
        away = {unit: float(np.linalg.norm(place * LENGTHS[unit][0] - middle)) for unit in ("metres", *units)}
        if not np.isfinite(place).all() or away["metres"] < REACH:
            continue
        unit = min(away, key=lambda one: away[one])
        what = f"{name} lies {away['metres']:.4g} m from the arm"
        if away[unit] < REACH:
            corrected = _scaled(corrected, (name,), LENGTHS[unit][0])
            what, cure = f"{what}: it is in {unit} as the others", "converted for this run"
        else:
            cure = "convert it to metres, or leave its cells empty where it was not seen"
        close = away[unit] < REACH
        found.append(RecordingFault(recording.name, "unit", _positions(name), what, cure, close))
    return corrected, tuple(found)


def _scaled(recording: Recording, bodies: tuple[str, ...], factor: float) -> Recording:
    names = {name for body in bodies for name in _positions(body)}
    columns = {name: v * factor if name in names else v for name, v in recording.columns.items()}
    return replace(recording, columns=columns)


def _positions(body: str) -> tuple[str, ...]:
    return tuple(f"{body}_{axis}_m" for axis in "xyz")


def _frames(recording: Recording, specimen: Specimen) -> Bodies:
    rest = {section.name: np.array(section.frame_origin_m) for section in specimen.sections}
    places = {name: _usual(recording.pose(name)[:, :3]) for name in recording.frames if name in rest}
    return {f"frame_{name}": (p, rest[name]) for name, p in places.items() if np.isfinite(p).all()}


def _markers(recording: Recording, specimen: Specimen) -> Bodies:
    known = [marker for marker in specimen.markers if marker.name in recording.markers]
    bodies = {}
    for marker in known:
        section = specimen.section(marker.section)
        rotation = from_quaternions(np.array(section.frame_quaternion))
        rest = np.array(section.frame_origin_m) + rotation @ np.array(marker.offset_m)
        place = _usual(recording.marker(marker.name))
        if np.isfinite(place).all():
            bodies[f"marker_{marker.name}"] = (place, rest)
    return bodies


def _sizes(
    recording: Recording, bodies: Bodies, kind: str, specimen: Specimen
) -> tuple[float, float, float] | None:
    """Return how far bodies lie apart as recorded, in the specimen [m], and the spread of the logarithm.

    A single frame shows by its travel.
    """
    if len(bodies) >= 2:
        places, rest = (list(one) for one in zip(*bodies.values(), strict=True))
        return _apart(places), _apart(rest), SIZE_SPREAD
    if kind == "frame" and len(bodies) == 1:
        ways = np.nanpercentile(recording.stack(_positions(*bodies)), [5.0, 95.0], axis=0)
        travel = float(np.linalg.norm(np.ptp(ways, axis=0)))
        return (travel, 0.4 * specimen.length_m, 1.2) if travel > 0.0 else None
    return None


def _usual(places: Floats) -> Floats:
    seen = places[np.isfinite(places).all(axis=1)]
    return np.median(seen, axis=0) if len(seen) else np.full(3, np.nan)


def _apart(places: list[Floats]) -> float:
    """Compute the rms distance of places from their mean."""
    points = np.array(places)
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
