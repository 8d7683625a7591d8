"""The sensors of a specimen: noise and alignment from its description, any one added by name."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softarm.estimator.errors import require_known
from softarm.estimator.rotations import exp, from_quaternions
from softarm.estimator.sensing import (
    ActuationMap,
    Bend,
    MarkerPosition,
    MeasuredPose,
    Measurement,
    Orientation,
    Registration,
)
from softarm.estimator.specimen import Specimen


def mounted_base(specimen: Specimen) -> Registration:
    """Return the map from the frame of the body on the base, as it was calibrated, to the base frame.

    For readings that are reported relative to that body.
    """
    base = specimen.sections[0]
    entry = specimen.calibration.frame(base.name)
    rest = from_quaternions(np.array(base.frame_quaternion))
    # The misalignment is given in the section's axes; `rest` rotates it to those of the base.
    rotation = rest @ exp(np.array(entry.misalignment_rad)) @ rest.T
    origin = np.array(base.frame_origin_m)
    return Registration(rotation, origin + rest @ np.array(entry.offset_m) - rotation @ origin)


@dataclass(frozen=True)
class SpecimenSensors:
    """Makes the measurements of a specimen.

    Args:
        specimen: Description, with its calibrated alignment.
        sections: Names of the sections in the order of the model that is measured.
        registration: Laboratory to base, for readings given in the laboratory frame.
    """

    specimen: Specimen
    sections: tuple[str, ...]
    registration: Registration

    @cached_property
    def _above(self) -> dict[str, int | None]:
        order = [section.name for section in self.specimen.sections]
        return {
            name: self.sections.index(before) if before in self.sections else None
            for before, name in zip([None, *order], order, strict=False)
        }

    def _index(self, section: str) -> int:
        require_known("sensor", "section", section, self.sections)
        return self.sections.index(section)

    def bend(self, section: str) -> Bend:
        """Return the two-axis bend against the section above, named ``bend_<section>``."""
        entry = self.specimen.calibration.bend(section)
        return Bend(
            f"bend_{section}",
            self._index(section),
            self.specimen.noise.bend_rad,
            reference=self._above[section],
            in_plane=entry.rotation_rad.value,
            bias=np.array([entry.bias_x_rad.value, entry.bias_y_rad.value]),
            mirrored=entry.mirrored,
        )

    def orientation(self, section: str, sigma: float | None = None) -> Orientation:
        """Orientation of a section, named ``orientation_<section>``.

        Args:
            section: The section.
            sigma: Standard deviation about each axis [rad]; the specimen's when left out.
        """
        return Orientation(
            f"orientation_{section}",
            self._index(section),
            self.specimen.noise.orientation_rad if sigma is None else sigma,
            np.array(self.specimen.calibration.frame(section).misalignment_rad),
            self.registration,
        )

    def pose(self, section: str) -> MeasuredPose:
        """Pose of a motion-capture body on a section, named ``frame_<section>``."""
        entry = self.specimen.calibration.frame(section)
        return MeasuredPose(
            f"frame_{section}",
            self._index(section),
            self.specimen.noise.position_m,
            self.specimen.noise.orientation_rad,
            np.array(entry.offset_m),
            np.array(entry.misalignment_rad),
            self.registration,
        )

    def named(self, name: str) -> Measurement:
        """Return the sensor of a name such as ``bend_tip``, ``orientation_tip`` or ``frame_tip``."""
        kind, _, section = name.partition("_")
        make: dict[str, Callable[[str], Measurement]] = {
            "bend": self.bend, "orientation": self.orientation, "frame": self.pose
        }  # fmt: skip
        return make[kind](section)

    def marker(self, name: str) -> MarkerPosition:
        """Marker of the specimen, named ``marker_<name>``.

        Raises:
            InputError: The specimen has no such marker.
        """
        markers = {marker.name: marker for marker in self.specimen.markers}
        require_known("sensor", "marker", name, markers)
        return MarkerPosition(
            f"marker_{name}",
            self._index(markers[name].section),
            self.specimen.noise.marker_m,
            np.array(markers[name].offset_m),
            self.registration,
        )

    def actuation(self) -> ActuationMap:
        """From recorded pressures to those in the chambers."""
        entries = [self.specimen.calibration.chamber(chamber.index) for chamber in self.specimen.chambers]
        none = (0.0,) * len(entries)
        return ActuationMap(
            np.array([entry.gain.value for entry in entries]),
            np.array([entry.bias_pa.value for entry in entries]),
            self.specimen.noise.pressure_pa,
            np.array([entry.curve_per_pa.value for entry in entries]),
            np.array([entry.quadratic_gain_per_pa2.value for entry in entries]),
            np.array([entry.crosstalk or none for entry in entries]),
        )
