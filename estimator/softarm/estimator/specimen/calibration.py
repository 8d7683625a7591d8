"""The result of calibration: how the arm, its actuators and its sensors differ from the description."""

from typing import Any

from pydantic import Field, model_validator

from softarm.estimator.specimen.body import Index
from softarm.estimator.specimen.entry import Entry, Finite, Name, NotNegative, Value, Vector

UNIT = Value(value=1.0)
ZERO = Value(value=0.0)


class ChamberCalibration(Entry):
    """How the pressure in the model's chamber follows from the recorded ones.

    It is gain * (1 + curve * r + quadratic_gain * r^2) * r + bias + crosstalk . recorded, where r is the
    chamber's own recorded pressure.
    """

    index: Index
    """Chamber."""
    gain: Value = UNIT
    """Factor on the recorded pressure [-]."""
    bias_pa: Value = ZERO
    """Pressure added after the gain."""
    curve_per_pa: Value = ZERO
    """Relative growth of the gain with the pressure [1/Pa], as the winding yields."""
    quadratic_gain_per_pa2: Value = ZERO
    """Relative growth of the gain with the square of the pressure [1/Pa2]."""
    crosstalk: tuple[Finite, ...] = ()
    """Share of every chamber's recorded pressure that acts here as well, its own 0 [-]; empty for none."""
    crosstalk_std: tuple[NotNegative, ...] = ()
    """Standard deviation of each."""

    @model_validator(mode="before")
    @classmethod
    def _earlier_key(cls, table: Any) -> Any:
        """Read ``bow_per_pa2``, which specimen files once called the quadratic gain."""
        if isinstance(table, dict) and "bow_per_pa2" in table:
            return {key.replace("bow_per", "quadratic_gain_per"): value for key, value in table.items()}
        return table


class BendCalibration(Entry):
    """Recorded bend = Rot(rotation) diag(1, -1 if mirrored else 1) model's bend + bias."""

    section: Name
    """Section whose bend it is."""
    rotation_rad: Value = ZERO
    """In-plane rotation of the recorded axes."""
    mirrored: bool = False
    """Whether the recorded second axis has the opposite sign."""
    bias_x_rad: Value = ZERO
    """Bias of the first recorded axis."""
    bias_y_rad: Value = ZERO
    """Bias of the second recorded axis."""


class FrameCalibration(Entry):
    """Recorded pose in the base frame: R_recorded = R exp(misalignment), p_recorded = p + R offset."""

    section: Name
    """Section whose pose it is."""
    misalignment_rad: Vector = (0.0, 0.0, 0.0)
    """Rotation vector of the recorded frame in the section's axes."""
    misalignment_std_rad: Vector = (0.0, 0.0, 0.0)
    """Standard deviation of each component."""
    offset_m: Vector = (0.0, 0.0, 0.0)
    """Origin of the recorded frame in the section's axes."""
    offset_std_m: Vector = (0.0, 0.0, 0.0)
    """Standard deviation of each component."""


class Calibration(Entry):
    """Results of ``softarm calibrate``; an empty table changes nothing."""

    recordings: tuple[str, ...] = ()
    """Recordings that the values came from."""
    provenance: str = ""
    """When and how they were made."""
    scatter: dict[str, float] = Field(default_factory=dict)
    """Scatter of measured minus predicted on data that no fit used, by sensor and quantity [m, rad]."""
    force_ratio: dict[str, float] = Field(default_factory=dict)
    """Error over deviation of forces at known pulls that no fit used, by condition and section [-]."""
    force_error: dict[str, float] = Field(default_factory=dict)
    """Relative error of forces, beside that deviation, by condition and section [-]."""
    force_memory: dict[str, Value] = Field(default_factory=dict)
    """Share of a force that the readings still show once it is over, by section [-]."""
    modulus_scale: dict[Name, Value] = Field(default_factory=dict)
    """Factor on the stiffness of each segment or section, by its name [-]."""
    fibre_scale: Value = UNIT
    """Factor on the stiffness of the fibres [-]."""
    stretch_gain: Value = ZERO
    """Relative growth of the effective pressure per unit of its chamber's stretch [-]."""
    chambers: tuple[ChamberCalibration, ...] = ()
    """Gain and bias of each chamber's pressure."""
    bends: tuple[BendCalibration, ...] = ()
    """Alignment and bias of each section's two-axis bend."""
    frames: tuple[FrameCalibration, ...] = ()
    """Alignment of each section's recorded pose."""

    def scale(self, region: str) -> float:
        """Return the factor on the stiffness of a segment or section; 1 where none was calibrated."""
        return self.modulus_scale.get(region, UNIT).value

    def chamber(self, index: int) -> ChamberCalibration:
        """Return the calibration of a chamber, or a unit gain without bias."""
        entries = (entry for entry in self.chambers if entry.index == index)
        return next(entries, ChamberCalibration(index=index))

    def bend(self, section: str) -> BendCalibration:
        """Return the calibration of a section's bend, or no alignment and no bias."""
        entries = (entry for entry in self.bends if entry.section == section)
        return next(entries, BendCalibration(section=section))

    def frame(self, section: str) -> FrameCalibration:
        """Return the calibration of a section's pose, or no misalignment."""
        entries = (entry for entry in self.frames if entry.section == section)
        return next(entries, FrameCalibration(section=section))
