"""State of the estimator in the service: the newest estimate, the tare and the contact."""

import asyncio
import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.daemon.estimation.messages import EstimationResult, HoldAnswer
from softarm.estimator.arrays import Floats
from softarm.estimator.model import Load
from softarm.estimator.rotations import from_quaternions
from softarm_client.messages import Contact, LoadEstimate, SectionPose, Vector

CONTACT_BEGINS = 4.0
CONTACT_ENDS = 2.5
"""Normalised force (Mahalanobis distance) at which a contact begins and ends."""
CONTACT_FLOOR_N = 0.02
"""Added to the standard deviation of the estimate: creep and hysteresis look like a force of this size."""
SPANNED = 1e-6
"""An axis is estimated when the loads' directions span it up to this."""
RECENT_S = 0.5
"""Age of the readings up to which commands and the feedback act on an estimate [s]: one search may fail."""


@dataclass(frozen=True)
class LoadMap:
    """Which loads of the model are the components of which section's force.

    Args:
        sections: Sections with a load, in order.
        rows: Index of each load's section, shape (loads,).
        directions: Direction of each load in the base frame, shape (loads, 3).
    """

    sections: tuple[str, ...]
    rows: tuple[int, ...]
    directions: Floats

    @classmethod
    def of(cls, loads: tuple[Load, ...]) -> "LoadMap":
        """Group forces by section."""
        sections = tuple(dict.fromkeys(load.section or load.name for load in loads))
        rows = tuple(sections.index(load.section or load.name) for load in loads)
        return cls(sections, rows, np.array([load.direction for load in loads]))

    @cached_property
    def not_estimated(self) -> tuple[str, ...]:
        """Name the axes along which no force is estimated: there the model has no load."""
        return tuple(
            f"force on {section} along {axis}: it is not estimated"
            for section, spans in zip(self.sections, self._spanned, strict=True)
            for axis, spanned in zip("xyz", spans, strict=True)
            if not spanned
        )

    @cached_property
    def _members(self) -> tuple[list[int], ...]:
        """Indices of the loads on each section."""
        places = range(len(self.sections))
        return tuple([row for row, place in enumerate(self.rows) if place == index] for index in places)

    @cached_property
    def _spanned(self) -> tuple[tuple[bool, ...], ...]:
        """Whether the loads of each section span each axis of the base frame."""
        spanned = []
        for members in self._members:
            directions = self.directions[members]
            projection = np.linalg.pinv(directions) @ directions
            spanned.append(tuple(bool(entry > 1.0 - SPANNED) for entry in np.diag(projection)))
        return tuple(spanned)

    @cached_property
    def _by_section(self) -> Floats:
        """Directions of the loads on each section, 0 for the others, shape (sections, 3, loads)."""
        on_section = np.arange(len(self.sections))[:, None] == np.array(self.rows, dtype=int)
        return np.ascontiguousarray(on_section[:, None, :] * self.directions.T)

    def vectors(self, amplitudes: Floats) -> tuple[Vector, ...]:
        """Convert load amplitudes to one force per section [N]."""
        return tuple((x, y, z) for x, y, z in (self._by_section @ amplitudes).tolist())

    def forces(self, amplitudes: Floats, covariance: Floats) -> tuple[LoadEstimate, ...]:
        """Convert load amplitudes to one force with covariance per section."""
        covariances = (self._by_section @ covariance @ self._by_section.transpose(0, 2, 1)).tolist()
        return tuple(
            LoadEstimate(
                section=section,
                force_n=force,
                covariance_n2=tuple(
                    tuple(
                        value if spanned[row] and spanned[column] else None
                        for column, value in enumerate(values)
                    )
                    for row, values in enumerate(cartesian)
                ),
            )
            for section, force, cartesian, spanned in zip(
                self.sections, self.vectors(amplitudes), covariances, self._spanned, strict=True
            )
        )


class EstimatorState:
    """Keeps the newest result of the estimator and what follows from it.

    Args:
        section_names: Sections in the model's order.
        loads: The model's loads.
        align: Aligns the inertial units with given rest orientations at a monotonic time and names them.
        clock_ns: Monotonic clock.
    """

    def __init__(
        self,
        section_names: tuple[str, ...],
        loads: tuple[Load, ...],
        align: Callable[[Mapping[str, Floats], int], tuple[str, ...]],
        clock_ns: Callable[[], int],
    ) -> None:
        self.load_map = LoadMap.of(loads)
        self.tare = np.zeros(len(loads))
        self.result: EstimationResult | None = None
        self.failures = 0
        self.contact_since_unix_ns: int | None = None
        self.contact: Contact | None = None
        self._held: tuple[HoldAnswer, EstimationResult] | None = None
        self._updated = asyncio.Event()
        self._names = section_names
        self._align = align
        self._clock_ns = clock_ns

    def fail(self) -> None:
        """Note a search that diverged: the last pose stays, but nothing may be steered by it."""
        self.failures += 1
        if self.result is not None:
            self.result = replace(self.result, converged=False, hold=None)
        self._updated.set()

    def update(self, result: EstimationResult, unix_ns: int) -> None:
        """Keep the newest result of the estimator; the wall clock dates a contact."""
        self.failures = 0 if result.converged else self.failures + 1
        self.result = result
        if result.hold is not None and result.hold.valid:
            self._held = result.hold, result
        # A contact neither begins nor ends by an estimate that did not converge.
        if result.converged:
            self._follow_contact(result, unix_ns)
        if self.contact_since_unix_ns is None:
            self.contact = None
        elif result.request.with_contact:
            self.contact = self._contact(result, self.contact_since_unix_ns)
        self._updated.set()

    async def wait_for_hold(self, seconds: float, pointless: Callable[[], bool]) -> None:
        """Wait until a result answers how the pose is held, for a limited time.

        Args:
            seconds: How long at most [s].
            pointless: Whether to wait no longer; called at every result and at every ``wake``.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(max(seconds, 0.0)):
                while self.hold_answer is None and not pointless():
                    self._updated.clear()
                    await self._updated.wait()

    def wake(self) -> None:
        """Make those who wait check whether there is still something to wait for."""
        self._updated.set()

    def _recent(self, result: EstimationResult) -> bool:
        """Return whether the readings of a result are not too old to act on."""
        # The arm may have moved elsewhere before the health checks report that no results come.
        return self._clock_ns() * 1e-9 - result.request.time_s <= RECENT_S

    @property
    def hold(self) -> HoldAnswer | None:
        """Pressures that would hold the measured pose, from the newest estimate; ``None`` when unknown."""
        answer = self.hold_answer
        return answer if answer is not None and answer.valid else None

    @property
    def hold_answer(self) -> HoldAnswer | None:
        """Answer of a recent newest estimate on holding the pose, also where it found no pressures."""
        return self.result.hold if self.result is not None and self._recent(self.result) else None

    @property
    def held(self) -> tuple[HoldAnswer, EstimationResult] | None:
        """Pressures that held the pose a moment ago, with that estimate; ``None`` when there are none."""
        if self._held is None or self.hold_answer is None or not self._recent(self._held[1]):
            return None
        return self._held

    @property
    def sections(self) -> tuple[SectionPose, ...]:
        """Section poses of the newest estimate."""
        return () if self.result is None else self.section_poses(self.result)

    def section_poses(self, result: EstimationResult) -> tuple[SectionPose, ...]:
        """Return the section poses of a result."""
        return tuple(
            SectionPose(
                section=name,
                position_m=position,
                quaternion_wxyz=quaternion,
                position_std_m=std[:3],
                rotation_std_rad=std[3:],
            )
            for name, position, quaternion, std in zip(
                self._names,
                result.positions.tolist(),
                result.quaternions.tolist(),
                result.frame_std.tolist(),
                strict=True,
            )
        )

    def tare_now(self) -> Floats | None:
        """Make the present force the zero and return it; without a recent, converged estimate do nothing."""
        if self.result is None or not self.result.converged or not self._recent(self.result):
            return None
        self.tare = self.result.loads.copy()
        self.contact_since_unix_ns, self.contact = None, None
        return self.tare

    def align_at_rest(self) -> tuple[str, ...]:
        """Align the inertial units with the arm at rest: with a recent estimate, else hanging straight."""
        recent = self.result if self.result is not None and self._recent(self.result) else None
        rotations = np.eye(3)[None] if recent is None else from_quaternions(recent.quaternions)
        named = zip(self._names, np.broadcast_to(rotations, (len(self._names), 3, 3)), strict=True)
        return self._align(dict(named), self._clock_ns())

    @staticmethod
    def _contact(result: EstimationResult, since_unix_ns: int) -> Contact | None:
        contact = result.contact
        if contact is None or not contact.located:
            return None
        return Contact(
            height_m=contact.height,
            height_std_m=contact.deviation,
            force_n=(float(contact.force[0]), float(contact.force[1])),
            since_unix_ns=since_unix_ns,
        )

    def _follow_contact(self, result: EstimationResult, unix_ns: int) -> None:
        # Two thresholds, so that a force near one of them does not report a contact at every estimate.
        net = result.loads - self.tare
        covariance = result.load_covariance + CONTACT_FLOOR_N**2 * np.eye(len(net))
        distance = float(np.sqrt(net @ np.linalg.solve(covariance, net) / max(len(net), 1)))
        if self.contact_since_unix_ns is None and distance > CONTACT_BEGINS:
            self.contact_since_unix_ns = unix_ns
        elif distance < CONTACT_ENDS:
            self.contact_since_unix_ns = None
