"""The pressures that the valve bank reports, chamber by chamber."""

from dataclasses import dataclass

Pressures = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class BankReading:
    """Pressures of all chambers, gauge, in Pa.

    Attributes:
        setpoint: The set-point; None while the chambers are vented.
        applied: What was last written, after limits, slew and the resolution of a count.
        echo: The set-point in the terminal; None where it does not report it.
        readback: What the terminal measures.
        diagnosis: Diagnosis word of each chamber's valve; zero is healthy.
        armed: Whether set-points are accepted.
    """

    setpoint: Pressures | None
    applied: Pressures
    echo: Pressures | None
    readback: Pressures
    diagnosis: tuple[int, ...]
    armed: bool


@dataclass(frozen=True, slots=True)
class ChamberMap:
    """Which valve feeds which chamber, and the pressure of one count.

    Attributes:
        valve_of: Index of the valve of each chamber.
        valves: How many valves the terminal has.
        pascal_per_count: Pressure of one count [Pa]; the terminals count in mbar unless configured otherwise.
    """

    valve_of: tuple[int, ...]
    valves: int
    pascal_per_count: float = 100.0

    def to_counts(self, pressures: Pressures, maximum: Pressures) -> tuple[int, ...]:
        """Return the nearest counts of every valve; a valve without chamber gets zero.

        A count that would exceed the maximum of its chamber goes down to the next one below.
        """
        counts = [0] * self.valves
        for valve, pressure, most in zip(self.valve_of, pressures, maximum, strict=True):
            counts[valve] = min(round(pressure / self.pascal_per_count), int(most // self.pascal_per_count))
        return tuple(counts)

    def to_pressures(self, counts: tuple[int, ...]) -> Pressures:
        """Convert the counts of every valve to the pressure of each chamber [Pa]."""
        return tuple(counts[valve] * self.pascal_per_count for valve in self.valve_of)

    def pick(self, words: tuple[int, ...]) -> tuple[int, ...]:
        """Select the words of the chambers from those of every valve."""
        return tuple(words[valve] for valve in self.valve_of)
