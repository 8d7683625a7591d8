"""The settings that QTM sends as XML, in the layouts before and from version 1.21."""

from collections.abc import Sequence
from xml.sax.saxutils import escape

Version = tuple[int, int]

NEW_LAYOUT: Version = (1, 21)
WITH_ENABLED: Version = (1, 24)


def parameters(version: Version, kinds: Sequence[str], bodies: Sequence[str], rate_hz: float) -> str | None:
    """Write the settings.

    Args:
        version: Protocol version that the client has set.
        kinds: Lower-case words after ``GetParameters``.
        bodies: Names of the bodies in the order of the data frames.
        rate_hz: Camera rate [Hz].

    Returns:
        The XML, or None when none of the requested settings exist.
    """
    sections = []
    if {"all", "general"} & set(kinds):
        sections.append(_general(version, rate_hz))
    if {"all", "6d"} & set(kinds):
        sections.append(_six_dof(version, bodies))
    if not sections:
        return None
    name = f"QTM_Parameters_Ver_{version[0]}.{version[1]:02d}"
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<{name}>{"".join(sections)}</{name}>\n'


def _general(version: Version, rate_hz: float) -> str:
    euler = '<EulerAngles First="Roll" Second="Pitch" Third="Yaw"/>' if version >= NEW_LAYOUT else ""
    return f"<General><Frequency>{rate_hz:g}</Frequency><Capture_Time>0</Capture_Time>{euler}</General>"


def _six_dof(version: Version, bodies: Sequence[str]) -> str:
    if version < NEW_LAYOUT:
        euler = "<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>"
        body = "".join(map(_old_body, bodies))
        return f"<The_6D><Bodies>{len(bodies)}</Bodies>{body}{euler}</The_6D>"
    return f"<The_6D>{''.join(_new_body(version, name) for name in bodies)}</The_6D>"


def _old_body(name: str) -> str:
    points = "".join(
        f"<Point><X>{x:f}</X><Y>{y:f}</Y><Z>0.000000</Z></Point>" for x, y in ((0, 0), (40, 0), (0, 25))
    )
    return f"<Body><Name>{escape(name)}</Name><RGBColor>65280</RGBColor>{points}</Body>"


def _new_body(version: Version, name: str) -> str:
    enabled = "<Enabled>true</Enabled>" if version >= WITH_ENABLED else ""
    points = "".join(
        f'<Point X="{x:f}" Y="{y:f}" Z="0.000000" Virtual="0" PhysicalId="0" Name="{k}"/>'
        for k, (x, y) in enumerate(((0, 0), (40, 0), (0, 25)), start=1)
    )
    rotation = " ".join(f'R{i}{j}="{float(i == j):f}"' for i in (1, 2, 3) for j in (1, 2, 3))
    return (
        f"<Body><Name>{escape(name)}</Name>{enabled}<Color R='0' G='255' B='0'/>"
        "<MaximumResidual>10.000000</MaximumResidual><MinimumMarkersInBody>3</MinimumMarkersInBody>"
        "<BoneLengthTolerance>5.000000</BoneLengthTolerance><Filter Preset='No filter'/>"
        f"<Points>{points}</Points>"
        "<Data_origin X='0.000000' Y='0.000000' Z='0.000000' Relative_body='0'>0</Data_origin>"
        f"<Data_orientation {rotation} Relative_body='0'>0</Data_orientation></Body>"
    )
