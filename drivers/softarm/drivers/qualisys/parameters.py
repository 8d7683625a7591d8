"""Rigid bodies in the settings of QTM: their names in the order of the data, and the Euler angles.

Up to protocol 1.20 the angle names stand in `The_6D/Euler`, from 1.21 as attributes of `General/EulerAngles`;
from 1.24 a body can be disabled.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import Final

from softarm.drivers.framing import FrameFault

STANDARD_EULER: Final = ("Roll", "Pitch", "Yaw")
"""The angles of the Qualisys standard: about x, then the new y, then the newest z."""


@dataclass(frozen=True, slots=True)
class Parameters:
    """The part of the settings that body data need.

    Args:
        bodies: Names, in the order of the settings.
        enabled: Of those, the ones that are not switched off, in the same order.
        euler: Names of the three angles, or empty if the settings lack them.
        frequency: Capture rate [Hz], or None if the settings lack it.
    """

    bodies: tuple[str, ...]
    enabled: tuple[str, ...]
    euler: tuple[str, ...] = ()
    frequency: float | None = None

    def names(self, count: int) -> tuple[str, ...] | None:
        """Return the names of `count` bodies in a data packet, or None if the settings do not fit it.

        Whether disabled bodies are in the data is documented nowhere; the count decides.
        """
        return next((names for names in (self.enabled, self.bodies) if len(names) == count), None)


def parse_parameters(text: str) -> Parameters | FrameFault:
    """Parse an XML packet in either layout, or return what is wrong with it."""
    # Entities can expand a few lines to gigabytes; QTM sends none.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        return FrameFault("xml", "settings with a document type: not from QTM")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        return FrameFault("xml", f"settings are not valid XML: {error}")
    if not root.tag.startswith("QTM_Parameters_Ver"):
        return FrameFault("xml", f"settings in an element {root.tag[:40]!r}")
    section = root.find("The_6D")
    bodies = [] if section is None else section.findall("Body")
    names = tuple(_text(body.find("Name")) for body in bodies)
    twice = sorted({name for name in names if names.count(name) > 1 or not name})
    if twice:
        return FrameFault("names", f"bodies with the same name: {', '.join(map(repr, twice))}")
    enabled = tuple(name for name, body in zip(names, bodies, strict=True) if _enabled(body))
    return Parameters(names, enabled, _euler(root), _frequency(root))


def _euler(root: ET.Element) -> tuple[str, ...]:
    angles = root.find("General/EulerAngles")
    if angles is not None:
        return tuple(angles.get(key, "") for key in ("First", "Second", "Third"))
    old = root.find("The_6D/Euler")
    return () if old is None else tuple(_text(old.find(key)) for key in ("First", "Second", "Third"))


def _frequency(root: ET.Element) -> float | None:
    try:
        return float(_text(root.find("General/Frequency")))
    except ValueError:
        return None


def _enabled(body: ET.Element) -> bool:
    return _text(body.find("Enabled")).lower() != "false"


def _text(element: ET.Element | None) -> str:
    return "" if element is None or element.text is None else element.text.strip()
