"""Who moves gauge and hand in a live experiment: the fakes' control port, or a person at the terminal."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from softarm.estimator.arrays import Floats
from softarm.experiments.rig_control import FakeControl


class ExperimentOperator(Protocol):
    """Moves what the service cannot move."""

    def tie(self, section: str, hook: Floats, length: float) -> Floats | None:
        """Tie the gauge's cord to a section, or move the gauge.

        Args:
            section: Name of the section.
            hook: Where its hook shall be, in the base frame [m], shape (3,).
            length: Of the cord [m].

        Returns:
            Where the hook is in the laboratory [m], shape (3,); ``None`` where nobody has measured it there.
        """

    def untie(self) -> None:
        """Untie the cord."""

    def guide(self, section: str, place: Floats) -> None:
        """Lead a section by hand towards a place in the base frame [m]."""

    def release(self) -> None:
        """Release the section."""


@dataclass
class FakeOperator:
    """Moves gauge and hand of the fakes.

    Args:
        control: Their control port.
        to_laboratory: Converts a place in the base frame to one in the laboratory [m].
        stiffness: Of the hand's grip [N/m].
    """

    control: FakeControl
    to_laboratory: Callable[[Floats], Floats]
    stiffness: float = 150.0

    def tie(self, section: str, hook: Floats, length: float) -> Floats:
        """See ``ExperimentOperator.tie``."""
        place = self.to_laboratory(hook)
        self.control.ask("cord", section=section, hook_m=place.tolist(), length_m=length)
        return place

    def untie(self) -> None:
        """See ``ExperimentOperator.untie``."""
        self.control.ask("cord")

    def guide(self, section: str, place: Floats) -> None:
        """See ``ExperimentOperator.guide``."""
        self.control.ask(
            "hand",
            section=section,
            position_m=self.to_laboratory(place).tolist(),
            stiffness_n_per_m=self.stiffness,
        )

    def release(self) -> None:
        """See ``ExperimentOperator.release``."""
        self.control.ask("hand")


@dataclass
class PromptedOperator:
    """Shows a person what to do and waits until it is done.

    Args:
        ask: Shows a sentence and returns when the person has confirmed.
    """

    ask: Callable[[str], None]
    tied: list[str] = field(default_factory=list)

    def tie(self, section: str, hook: Floats, length: float) -> None:
        """See ``ExperimentOperator.tie``."""
        place = ", ".join(f"{1e3 * value:.0f}" for value in hook)
        what = (
            "Move the gauge"
            if section in self.tied
            else f"Tie the {1e3 * length:.0f} mm cord to the {section}"
        )
        self.tied.append(section)
        self.ask(f"{what} so that its hook is at ({place}) mm in the base frame.")

    def untie(self) -> None:
        """See ``ExperimentOperator.untie``."""
        self.tied.clear()
        self.ask("Take the cord off and let the arm hang free.")

    def guide(self, section: str, place: Floats) -> None:
        """See ``ExperimentOperator.guide``."""
        where = ", ".join(f"{1e3 * value:.0f}" for value in place)
        self.ask(f"Guide the {section} by hand to about ({where}) mm in the base frame and hold it there.")

    def release(self) -> None:
        """See ``ExperimentOperator.release``."""
        self.ask("Let go of the arm.")
