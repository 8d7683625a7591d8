"""Units of pressures and angles, and gauge against absolute pressure, by what the specimen can be.

| quantity | what is known beforehand |
|---|---|
| largest pressure over the limit | log-normal about 0.6; seldom above 1 |
| lowest pressure | a gauge pressure comes down to about 0 at some time, an absolute one to that of the air |
| bend at the limit | log-normal about 0.8 rad, a factor of 2.7: it bends visibly, not around itself |
| measured over commanded pressure | 1 within 15 % |
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.bend_units import (
    ANGLES,
    DRIVEN,
    angle_columns,
    around_themselves,
    in_radians,
    mixed_bends,
    slopes_by_pressure,
)
from softarm.estimator.intake.clocks import correct_clocks
from softarm.estimator.intake.hypotheses import Explanation, choose
from softarm.estimator.intake.lengths import correct_lengths
from softarm.estimator.intake.lost import without_zeros
from softarm.estimator.intake.result import Kind, RecordingFault
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import MAD_TO_STD

PRESSURES = {
    "pascals": (1.0, 0.0),
    "kilopascals": (1e3, -3.0),
    "millibars": (1e2, -4.0),
    "bars": (1e5, -4.0),
    "pounds per square inch": (6894.757, -5.0),
    "megapascals": (1e6, -6.0),
}
"""Factor to pascals and logarithm of the prior over that of pascals."""
STATED = {
    "Pa": "pascals",
    "kPa": "kilopascals",
    "MPa": "megapascals",
    "mbar": "millibars",
    "hPa": "millibars",
    "bar": "bars",
    "psi": "pounds per square inch",
}
"""Units that ``pressure_unit`` may state."""
BEYOND_LIMIT = 10.0
"""Times the limit that no pressure reaches: no chamber bears it, so a unit that implies it is wrong."""
USUAL_PRESSURE, BELOW, ABOVE = 0.6, 1.0, 0.4
"""Usual largest pressure over the limit, and its spread (logarithm) below and above."""
USUAL_BEND, BEND_SPREAD = 0.8, 1.0
"""Usual bend at the limit [rad] and the spread of its logarithm, that of a modulus unknown to a factor
of five and of chambers that nobody measured."""
AIR = (70e3, 110e3)
"""Pressure of the air from high mountains to sea level [Pa]."""
ABSOLUTE = 3.0
"""Minus the logarithm of the prior that pressures are absolute."""
NEVER_VENTED = -6.0
"""Logarithm of the prior that no chamber ever comes below half of the largest pressure."""
NOISY = 0.15
"""Change from sample to sample over the range from which pressures are noise; white noise has 0.29."""
SAME_AIR = 2e3
"""Vented chambers read the same air within this [Pa]."""
RESTS = 20
"""Readings of vented chambers that show the pressure of the air."""
FOLLOWS = 0.15
ANY_PRESSURE = 1e4
"""Change [Pa] to which all pressures are brought where only their course in time counts."""
STRAYED = 30.0
"""Times by which a chamber's pressures change less than those of the others, as in another unit."""
MISSED = 0.7
"""Share of what the other chambers leave of the bends that such a chamber, if it acts, leaves at most."""
FOLLOWED = 0.9
"""Correlation from which a measured pressure and its set-point are of one chamber."""


@dataclass(frozen=True)
class Units:
    """Units of a recording's pressures and bends.

    Args:
        measured: Unit of the measured pressures.
        commanded: Unit of the commanded pressures.
        angle: Unit of the bends.
        absolute: Whether the measured pressures are absolute.
        absolute_commands: Whether the commanded pressures are.
    """

    measured: str = "pascals"
    commanded: str = "pascals"
    angle: str = "radians"
    absolute: bool = False
    absolute_commands: bool = False

    def above_vacuum(self, kind: str) -> bool:
        """Whether the pressures of a kind are absolute."""
        return self.absolute_commands if kind == "commanded" else self.absolute


def correct_units(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring pressures to gauge pressures in pascals, bends to radians, lengths to metres.

    Returns:
        The recording, corrected where one explanation wins, and what was found.
    """
    corrected, lengths = correct_lengths(recording, specimen)
    stated, contradictions = _stated(corrected, specimen)
    if contradictions:
        return corrected, (*lengths, *contradictions)
    aligned = _aligned(corrected, specimen)
    in_degrees, mixed = mixed_bends(corrected, aligned, specimen)
    if not all(one.corrected for one in mixed):
        return corrected, (*lengths, *mixed)
    corrected, aligned = (in_radians(one, in_degrees) for one in (corrected, aligned))
    strays: tuple[RecordingFault, ...] = ()
    if stated is None:
        corrected, strays = _single_chambers(corrected, aligned, specimen)
    corrected, found = _pressures_and_bends(corrected, aligned, specimen, stated)
    if all(one.corrected for one in found):
        corrected, absolute = _single_absolute(corrected, specimen)
        found = (*found, *absolute)
    return corrected, (*lengths, *mixed, *strays, *found)


def pressure_columns(recording: Recording, kind: str) -> tuple[str, ...]:
    """List the columns of ``measured`` or ``commanded`` pressures."""
    names = (f"pressure_{'cmd_' if kind == 'commanded' else ''}{k}_pa" for k in recording.chambers)
    return tuple(name for name in names if name in recording.columns)


def _stated(recording: Recording, specimen: Specimen) -> tuple[str | None, tuple[RecordingFault, ...]]:
    """Read the unit that ``pressure_unit`` states, ``None`` without one; refuse one that cannot be."""
    stated = recording.info.get("pressure_unit")
    if stated is None or not recording.chambers:
        return None, ()
    names = {name.lower(): unit for name, unit in STATED.items()}
    unit = names.get(str(stated).strip().lower())
    listed = ", ".join(STATED)
    if unit is None:
        what = f"pressure_unit is {stated!r} in recording.toml, which is none of {listed}"
        cure = "convert the pressures to Pa, or state one of these"
        return None, (RecordingFault(recording.name, "unit", ("pressures",), what, cure, corrected=False),)
    limit = max(specimen.pressure_limits, default=np.inf)
    for kind in ("measured", "commanded"):
        sizes = _sizes(recording, kind)
        top = sizes[1] * PRESSURES[unit][0] if sizes is not None else 0.0
        if unit != "pascals" and top > BEYOND_LIMIT * limit:
            what = (
                f"pressure_unit is {stated!r} in recording.toml, in which the {kind} pressures would reach "
                f"{top / 1e3:.4g} kPa, {top / limit:.0f} times the limit of {limit / 1e3:.0f}"
            )
            cure = "correct pressure_unit, or the columns"
            columns = pressure_columns(recording, kind)
            return unit, (RecordingFault(recording.name, "unit", columns, what, cure, corrected=False),)
    return unit, ()


def _pressures_and_bends(
    recording: Recording, aligned: Recording, specimen: Specimen, stated: str | None
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    choice = choose(_explanations(recording, aligned, specimen, stated))
    found = choice.best.what
    if found == Units():
        return recording, ()
    columns, words = _named(recording, found)
    if not choice.unambiguous:
        other = "; ".join(_named(recording, choice.second.what)[1]) or "pascals and radians as named"
        cure = f"convert the columns, or set pressure_unit (odds only {choice.odds:.0f})"
        return recording, (
            RecordingFault(
                recording.name, "unit", columns, f"{'; '.join(words)}, or {other}", cure, False, choice.odds
            ),
        )
    offsets = {
        kind: _air(recording, found, kind) for kind in ("measured", "commanded") if found.above_vacuum(kind)
    }
    if None in offsets.values():
        what = f"{'; '.join(words)}, and no vented stretch shows the pressure of the air"
        cure = "subtract the pressure of the air from the columns, or record a vented stretch"
        return recording, (RecordingFault(recording.name, "offset", columns, what, cure, False, choice.odds),)
    known = {kind: air for kind, air in offsets.items() if air is not None}
    corrected = _converted(recording, found, known)
    if stated:
        corrected = replace(corrected, info={**corrected.info, "pressure_unit": "Pa"})
    kind: Kind = "offset" if known else "unit"
    airs = " and ".join(f"{air:.0f}" for air in known.values())
    done = f"counted as {airs} Pa above vacuum at rest and converted" if known else "converted for this run"
    return corrected, (
        RecordingFault(recording.name, kind, columns, "; ".join(words), done, True, choice.odds),
    )


def _single_chambers(
    recording: Recording, aligned: Recording, specimen: Specimen
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring chambers to the unit of the others that change far less than these and act all the same."""
    columns, found, spans = dict(recording.columns), [], _spans(recording)
    for kind in ("measured", "commanded"):
        own = {name: spans[name] for name in pressure_columns(recording, kind)}
        usual = float(np.median([span for span in own.values() if span > 0.0] or [0.0]))
        for name, span in own.items():
            shown = spans.get(_other_column(name), 0.0)
            moves = shown > usual / STRAYED
            if not 0.0 < span < usual / STRAYED or shown == 0.0:
                continue
            both = (name,) if moves else (name, _other_column(name))  # of a hardly opened one, both are small
            if not all(_acts(recording, aligned, specimen, one, moves=moves) for one in both):
                continue
            wanted = shown if moves else usual
            unit = min(PRESSURES, key=lambda one: abs(np.log(PRESSURES[one][0] * span / wanted)))
            if unit == "pascals":  # its other column shows that the chamber was hardly opened
                continue
            columns[name] = recording.columns[name] * PRESSURES[unit][0]
            top = float(np.nanmax(recording.columns[name]))
            what = f"{name} reaches {top:.4g} and changes {usual / span:.0f} times less than other chambers"
            cure = f"taken for {unit} beside pascals and converted for this run"
            found.append(RecordingFault(recording.name, "unit", (name,), what, cure))
    return replace(recording, columns=columns), tuple(found)


def _other_column(name: str) -> str:
    """Name the column of what was commanded of what was measured, and the other way."""
    return name.replace("cmd_", "") if "cmd" in name else name.replace("pressure_", "pressure_cmd_")


def _spans(recording: Recording) -> dict[str, float]:
    """Return by how much each pressure changes, by its column; see ``_span``."""
    kinds = ("measured", "commanded")
    return {
        name: _span(recording.columns[name]) for kind in kinds for name in pressure_columns(recording, kind)
    }


def _span(column: Floats) -> float:
    """Return by how much a pressure changes; zero where it is noise, or was never read."""
    read = column[np.isfinite(column)]
    if len(read) < 3:
        return 0.0
    within = np.percentile(read, [1.0, 99.5])
    return 0.0 if _white(read, within) else float(np.ptp(within))


def _acts(recording: Recording, aligned: Recording, specimen: Specimen, name: str, *, moves: bool) -> bool:
    """Return whether a pressure that hardly changes acts: as its other column does, or on the bends.

    Its other column must have changed: where that rests or was never read, the chamber may be idle, and what
    a closed one reads follows the bends as well.

    Args:
        recording: As it was recorded.
        aligned: The same with pressures and motion on one clock.
        specimen: The robot.
        name: Column of the pressure.
        moves: Whether its other column changes as far as those of other chambers do.
    """
    own, partner = recording.columns[name], recording.columns[_other_column(name)]
    both = np.isfinite(own) & np.isfinite(partner)
    if moves and both.sum() > 2 and float(np.corrcoef(own[both], partner[both])[0, 1]) > FOLLOWED:
        return True
    bends, own = _bends_or_places(aligned, specimen), aligned.columns[name]
    if bends is None:
        return False
    rest = [aligned.pressure(k)[0] for k in aligned.chambers if f"_{k}_pa" not in name]
    p = np.column_stack([np.ones(len(own)), *rest, own])
    valid = np.isfinite(p).all(axis=1) & np.isfinite(bends).all(axis=1)
    if valid.sum() < 20:
        return False
    p, y = p[valid] / np.maximum(np.abs(p[valid]).max(axis=0), 1e-12), bends[valid]
    without, beside = (
        float(((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2).sum()) for x in (p[:, :-1], p)
    )
    return beside < MISSED * without


def _aligned(recording: Recording, specimen: Specimen) -> Recording:
    """Move pressures and motion onto one clock, whatever their units, where the recording shows a shift."""
    sizes = _spans(recording)
    plain = {name: recording.columns[name] * (ANY_PRESSURE / size) for name, size in sizes.items() if size}
    seen = without_zeros(replace(recording, columns={**recording.columns, **plain}))
    corrected, _ = correct_clocks(seen, specimen)
    back = {name: corrected.columns[name] * (sizes[name] / ANY_PRESSURE) for name in plain}
    return replace(corrected, columns={**corrected.columns, **back})


def _explanations(
    recording: Recording, aligned: Recording, specimen: Specimen, stated: str | None
) -> list[Explanation[Units]]:
    limit = max(specimen.pressure_limits, default=0.0)
    sizes = {kind: _sizes(recording, kind) if limit else None for kind in ("measured", "commanded")}
    slope = _bend_per_pressure(aligned, specimen) if limit and recording.chambers else None
    ratio = _measured_over_commanded(recording)
    options = {
        kind: (stated if stated and pressure_columns(recording, kind) else "pascals",)
        if stated or sizes[kind] is None
        else tuple(PRESSURES)
        for kind in ("measured", "commanded")
    }
    angles = tuple(ANGLES) if slope is not None and recording.bends else ("radians",)
    if around_themselves(recording):
        angles = ("degrees",)
    absolute, absolute_commands = (
        (False, True) if sizes[kind] is not None else (False,) for kind in ("measured", "commanded")
    )
    found = []
    for measured, commanded, angle, above_vacuum, above_too in product(
        options["measured"], options["commanded"], angles, absolute, absolute_commands
    ):
        units = Units(measured, commanded, angle, above_vacuum, above_too)
        value = PRESSURES[measured][1] + PRESSURES[commanded][1] + ANGLES[angle][1]
        value -= ABSOLUTE * (above_vacuum + above_too)
        if sizes["measured"] is not None:
            value += _pressure_likelihood(*sizes["measured"], PRESSURES[measured][0], limit, above_vacuum)
        if sizes["commanded"] is not None:
            value += _pressure_likelihood(*sizes["commanded"], PRESSURES[commanded][0], limit, above_too)
        if slope is not None:
            kind, unit = ("measured", measured) if sizes["measured"] is not None else ("commanded", commanded)
            factor, largest = PRESSURES[unit][0], sizes[kind]
            # What is stated to stay far below the limit bends no arm as far as the limit would.
            reached = min(limit, largest[1] * factor) if stated and largest is not None else limit
            bend = slope * ANGLES[angle][0] / factor * reached
            value -= 0.5 * (np.log(max(bend, 1e-12) / USUAL_BEND) / BEND_SPREAD) ** 2
        if ratio is not None:
            off = np.log(ratio * PRESSURES[measured][0] / PRESSURES[commanded][0]) / FOLLOWS
            value -= 0.5 * min(float(off**2), 200.0)
        found.append(Explanation(units, float(value)))
    return found


def _pressure_likelihood(low: float, high: float, factor: float, limit: float, absolute: bool) -> float:
    """Compare the lowest and largest pressure of all chambers with a limit [Pa]."""
    low, high = low * factor, high * factor
    if absolute:
        if not AIR[0] < low < AIR[1]:
            return -1e3
        low, high = 0.0, high - low
    away = np.log(max(high, 1e-9) / (USUAL_PRESSURE * limit))
    value = -0.5 * (away / (ABOVE if away > 0 else BELOW)) ** 2
    return float(value + (NEVER_VENTED if low > 0.5 * high else 0.0))


def _sizes(recording: Recording, kind: str) -> tuple[float, float] | None:
    """Find the lowest and the largest pressure as recorded; ``None`` where none changes."""
    names = pressure_columns(recording, kind)
    values = [recording.columns[name][np.isfinite(recording.columns[name])] for name in names]
    values = [column for column in values if len(column)]
    if not values:
        return None
    ranges = [np.percentile(column, [1.0, 99.5]) for column in values]
    low, high = min(float(r[0]) for r in ranges), max(float(r[1]) for r in ranges)
    moved = max(float(np.ptp(r)) for r in ranges)
    steps = [np.median(np.abs(np.diff(column))) if len(column) > 2 else 0.0 for column in values]
    # By medians, since spikes are only removed once their unit is known.
    noise = MAD_TO_STD * float(max(steps))
    quiet = noise < NOISY * moved and not _white(
        *max(zip(values, ranges, strict=True), key=lambda one: np.ptp(one[1]))
    )
    return (low, high) if high > 0.0 and moved > 0.0 and quiet else None


def _white(column: Floats, within: Floats) -> bool:
    """Return whether readings scatter without memory, as those of a vented chamber in steps of an instrument.

    The mean square of successive differences is twice the variance of white noise (von Neumann 1941).
    """
    usual = np.clip(column, *within)
    return len(usual) > 2 and float(np.mean(np.diff(usual) ** 2)) > float(usual.var()) > 0.0


def _bend_per_pressure(recording: Recording, specimen: Specimen) -> float | None:
    """Regress the bends on the pressures: the median chamber's largest slope, as recorded."""
    bends = _bends_or_places(recording, specimen)
    if bends is None:
        return None
    pressures = np.column_stack([recording.pressure(k)[0] for k in recording.chambers])
    read = np.isfinite(pressures) | ~np.isfinite(pressures).any(axis=0)
    pressures = np.nan_to_num(pressures)
    moved = np.ptp(pressures, axis=0) > DRIVEN * max(float(np.ptp(pressures, axis=0).max(initial=0.0)), 1e-12)
    seen = read.all(axis=1) & np.isfinite(bends).all(axis=1)
    if not moved.any() or seen.sum() < 20:
        return None
    slopes = slopes_by_pressure(pressures[seen][:, moved], bends[seen])
    if slopes is None:
        return None
    sizes = np.linalg.norm(slopes.reshape(len(slopes), -1, 2 if recording.bends else 3), axis=2).max(axis=1)
    return float(np.median(sizes))


def _bends_or_places(recording: Recording, specimen: Specimen) -> Floats | None:
    """Stack the bends as recorded, or what they must be where only places were [rad]; ``None`` without both.

    An arm of length L that bends evenly by an angle moves its end aside by half the angle times L.
    """
    if recording.bends:
        return np.column_stack([recording.bend(section) for section in recording.bends])
    known = {section.name: section.frame_origin_m[2] for section in specimen.sections}
    places = [(known[name], recording.pose(name)[:, :3]) for name in recording.frames if known.get(name)]
    moved = [m for m in specimen.markers if m.name in recording.markers and known[m.section]]
    places += [(known[marker.section], recording.marker(marker.name)) for marker in moved]
    return np.column_stack([2.0 / height * place for height, place in places]) if places else None


def _measured_over_commanded(recording: Recording) -> float | None:
    """Find the usual change of a measured over that of its commanded pressure; ``None`` without both."""
    ratios = []
    for k in recording.chambers:
        names = (f"pressure_{k}_pa", f"pressure_cmd_{k}_pa")
        both = [recording.columns[name] for name in names if name in recording.columns]
        ranges = [float(np.ptp(np.nanpercentile(c, [2.0, 98.0]))) for c in both if np.isfinite(c).any()]
        if len(ranges) == 2 and min(ranges) > 0.0:
            ratios.append(ranges[0] / ranges[1])
    return float(np.median(ratios)) if ratios else None


def _air(recording: Recording, units: Units, kind: str) -> float | None:
    """Find the pressure of the air [Pa]: the lowest of most chambers, where they agree."""
    factor = PRESSURES[getattr(units, kind)][0]
    lows = sorted(
        float(np.nanpercentile(recording.columns[name], 1.0)) * factor
        for name in pressure_columns(recording, kind)
    )
    alike = [low for low in lows if low - lows[0] < SAME_AIR]
    return float(np.mean(alike)) if len(alike) >= min(2, len(lows)) else None


def _single_absolute(
    recording: Recording, specimen: Specimen
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Bring single absolute pressures [Pa] beside gauge pressures to gauge pressures.

    The lowest reading of such a sensor is near the pressure of the air, above the limit of its chamber. It is
    that of the air where the sensor rests at it while the chamber's other column is at zero, or, without one,
    while all other chambers are.
    """
    columns, found = dict(recording.columns), []
    lows = {name: _lowest(recording.columns[name]) for name in _all_pressures(recording)}
    strays = [name for name, low in lows.items() if AIR[0] < low < AIR[1] and low > _limit(name, specimen)]
    for name in strays:
        values, low, other = recording.columns[name], lows[name], _other_column(name)
        others = [other] if other in lows else [n for n in lows if ("cmd" in n) == ("cmd" in name)]
        zero = [np.abs(recording.columns[n]) < SAME_AIR for n in others if n not in strays]
        vented = np.isfinite(values) & np.all(zero, axis=0) if zero else np.zeros(len(values), dtype=bool)
        air = float(np.median(values[vented])) if vented.sum() >= RESTS else np.inf
        known = air - low < SAME_AIR
        what = (
            f"{name} never comes below {low / 1e3:.1f} kPa, near the pressure of the air and above the "
            f"limit of {_limit(name, specimen) / 1e3:.0f}: it is absolute"
        )
        cure = (
            f"{air:.0f} Pa, its reading at rest, were subtracted for this run"
            if known
            else "subtract the pressure of the air from it, or record a stretch with all chambers vented"
        )
        columns[name] = values - air if known else values
        found.append(RecordingFault(recording.name, "offset", (name,), what, cure, known))
    return replace(recording, columns=columns), tuple(found)


def _all_pressures(recording: Recording) -> tuple[str, ...]:
    return tuple(n for kind in ("measured", "commanded") for n in pressure_columns(recording, kind))


def _lowest(values: Floats) -> float:
    """Return the lowest reading but for noise; that of a column without any is zero."""
    read = values[np.isfinite(values)]
    return float(np.percentile(read, 1.0)) if len(read) else 0.0


def _limit(name: str, specimen: Specimen) -> float:
    """Return the limit of the chamber of a column [Pa]."""
    return specimen.pressure_limits[int(name.split("_")[-2])]


def _named(recording: Recording, units: Units) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the columns at fault and state how they differ."""
    columns: list[str] = []
    words: list[str] = []
    for kind in ("measured", "commanded"):
        unit = getattr(units, kind)
        above_vacuum = units.above_vacuum(kind)
        if unit == "pascals" and not above_vacuum:
            continue
        names = pressure_columns(recording, kind)
        columns += names
        top = max(float(np.nanmax(recording.columns[name])) for name in names)
        above = "absolute, " if above_vacuum else ""
        words.append(f"the {kind} pressures reach {top:.4g} and are {above}in {unit}")
    if units.angle != "radians":
        names = angle_columns(recording.bends)
        columns += names
        top = max(float(np.nanmax(np.abs(recording.columns[name]))) for name in names)
        words.append(f"the bends reach {top:.4g} and are in {units.angle}")
    return tuple(columns), tuple(words)


def _converted(recording: Recording, units: Units, offsets: Mapping[str, float]) -> Recording:
    columns = dict(recording.columns)
    for kind in ("measured", "commanded"):
        factor = PRESSURES[getattr(units, kind)][0]
        for name in pressure_columns(recording, kind):
            columns[name] = columns[name] * factor - offsets.get(kind, 0.0)
    for name in angle_columns(recording.bends):
        columns[name] = columns[name] * ANGLES[units.angle][0]
    return replace(recording, columns=columns)
