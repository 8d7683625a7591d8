"""In which directions pressures bend the arm: whether a laboratory is rotated about its axis, or mirrored.

A chamber at the azimuth phi bends the arm away from it. With u_s = -sum_k exp(i phi_k) p_k over the chambers
of segment s, the lateral place x + i y of a body below follows sum_s g_s u_s, and in a mirrored laboratory
sum_s g_s conj(u_s). The angle of the g_s is that by which the laboratory is rotated about the arm's axis.
Pressures that only rise and fall together fit both, and decide nothing.

One chamber alone moves the arm along one line. That fits both too, but shows by how much the line is rotated:
where it is far off the chamber's azimuth, the frame is not the specimen's, mirrored or not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from softarm.estimator.arrays import Complex, Floats
from softarm.estimator.intake.bend_units import DRIVEN
from softarm.estimator.intake.grid import pushes_of
from softarm.estimator.recording import Recording
from softarm.estimator.specimen import Specimen

LEAST_SAMPLES, MOST_SAMPLES = 20, 2000
LEAST_MOTION = 2e-3
"""Standard deviation of the lateral motion below which it shows no direction [m]."""
EXPLAINED = 0.3
"""Share of the motion's variance that directions may leave to count as seen; good recordings leave 0.15."""
CLEAR = 3.0
"""So many times the variance the other handedness must leave."""
SWINGING = 2.0 / 3.0
"""Share of the variance that motion along a line may leave: a pressure that is on for half of the time, and a
swing without any damping about both rests, leave as much."""
OVER_NOISE = 3.0
"""Standard deviation of motion along a line, in those of a marker's noise, from which it shows a direction:
noise then leaves a twentieth of the variance across the line."""
LEAST_ROTATION = np.radians(35.0)
"""Rotation about the arm's axis from which the laboratory counts as rotated. In 400 simulated recordings of
SoPrA with up to two faults of the arm, the 224 that show directions are rotated by up to 21 degrees."""


@dataclass(frozen=True)
class LooseBody:
    """A frame or a marker below the base.

    Args:
        name: What a message calls it.
        above: From where on it is moved: the upper end of its section along the arm [m].
        rest: Where it is at rest in the base frame [m], shape (3,).
        place: Where it was recorded [m], shape (samples, 3).
    """

    name: str
    above: float
    rest: Floats
    place: Floats


@dataclass(frozen=True)
class BendingDirections:
    """In which directions pressures bend the arm.

    Args:
        left: Share of the variance of the lateral motion that the specimen's azimuths leave.
        mirrored: Share that they leave in a mirrored laboratory.
        mixed: Share that they leave where some segments, not all, are mirrored; infinite for one segment.
        rotation: By how much the laboratory is rotated about the arm's axis [rad], unless it is mirrored.
        across: Share of the variance across the line along which a chamber bends the arm that is driven
            alone; infinite where several are driven.
    """

    left: float
    mirrored: float
    mixed: float
    rotation: float
    across: float = np.inf

    @property
    def as_specimen(self) -> bool:
        """Whether the arm bends as the specimen's azimuths predict, and clearly not mirrored."""
        return self.is_handed and abs(self.rotation) < LEAST_ROTATION

    @property
    def is_mirrored(self) -> bool:
        """Whether the arm clearly bends as in a mirrored laboratory."""
        return self.mirrored < min(EXPLAINED, self.left / CLEAR, self.mixed)

    @property
    def is_rotated(self) -> bool:
        """Whether the laboratory is clearly rotated about the arm's axis; see ``is_handed``."""
        return (self.is_handed or self._on_line) and abs(self.rotation) >= LEAST_ROTATION

    @property
    def is_handed(self) -> bool:
        """Whether pressures show that the laboratory is not mirrored."""
        return self.left < min(EXPLAINED, self.mirrored / CLEAR)

    @property
    def is_decided(self) -> bool:
        """Whether it is clear which of these holds."""
        return self.as_specimen or self.is_mirrored or self.is_rotated

    @property
    def _on_line(self) -> bool:
        return self.left < SWINGING and self.across < EXPLAINED


def bending_directions(
    recording: Recording, specimen: Specimen, bodies: Sequence[LooseBody]
) -> BendingDirections | None:
    """Regress lateral places on the pressures' directions; ``None`` where too little moves.

    Args:
        recording: With gauge pressures in Pa.
        specimen: With the azimuths of the chambers.
        bodies: With places in the base frame, or in that of a laboratory that is to be compared with it.
    """
    heights, inputs, alone = _inputs(recording, specimen)
    if not len(heights):
        return None
    left = dict.fromkeys(product((False, True), repeat=len(heights)), 0.0)
    total, across, samples, slopes = 0.0, 0.0, 0, 0.0j
    for body in bodies:
        moved = heights < body.above
        valid = np.flatnonzero(np.isfinite(inputs).all(axis=1) & np.isfinite(body.place).all(axis=1))
        valid = valid[:: max(len(valid) // MOST_SAMPLES, 1)]
        if len(valid) < LEAST_SAMPLES or not moved.any():
            continue
        place = body.place[valid, 0] + 1j * body.place[valid, 1]
        place = place - place.mean()
        total, samples = total + float((np.abs(place) ** 2).sum()), samples + len(valid)
        centred = inputs[valid] - inputs[valid].mean(axis=0)
        for mirrored in left:
            columns = np.where(mirrored, centred.conj(), centred)[:, moved]
            found, *_ = np.linalg.lstsq(columns, place, rcond=1e-3)
            left[mirrored] += float((np.abs(place - columns @ found) ** 2).sum())
            if not any(mirrored):
                slopes += complex((found * columns.std(axis=0)).sum())
                across += _across(place, columns @ found)
    if total <= samples * (OVER_NOISE * specimen.noise.marker_m if alone else LEAST_MOTION) ** 2:
        return None
    plain, whole = (False,) * len(heights), (True,) * len(heights)
    mixed = min((own for mirrored, own in left.items() if mirrored not in (plain, whole)), default=np.inf)
    shares = left[plain] / total, left[whole] / total, mixed / total
    return BendingDirections(*shares, float(np.angle(slopes)), across / total if alone else np.inf)


def _across(place: Complex, fitted: Complex) -> float:
    """Sum up the squares of places across the line of fitted ones [m2], both of shape (samples,)."""
    along = np.exp(-0.5j * np.angle((fitted**2).sum()))
    return float((np.imag(place * along) ** 2).sum())


def _inputs(recording: Recording, specimen: Specimen) -> tuple[Floats, Complex, bool]:
    """Return what drives the segments.

    Returns:
        Heights of the segments with pressures [m], u of each [Pa], shape (samples, segments), and whether
        one chamber alone is driven.
    """
    pressures = np.array([recording.pressure(k)[0] for k in recording.chambers])
    pressures = pressures.reshape(len(recording.chambers), len(recording.time)).T
    pushes = pushes_of(pressures, recording.chambers, specimen)
    filled = {specimen.chambers[k].segment for k in recording.chambers}
    driven = np.array([segment.name in filled for segment in specimen.segments], dtype=bool)
    heights = np.array([segment.from_m for segment in specimen.segments])
    read = pressures[np.isfinite(pressures).all(axis=1)]
    spans = np.ptp(np.percentile(read, [1.0, 99.0], axis=0), axis=0) if read.size else np.zeros(1)
    alone = int((spans > DRIVEN * spans.max()).sum()) == 1
    return heights[driven], pushes[:, driven], alone
