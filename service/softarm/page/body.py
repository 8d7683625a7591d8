"""What the page shows of a specimen; everything else in it is ignored."""

from softarm_client.messages import Message, Vector


class RigidSection(Message):
    """A rigid section at rest, in the base frame.

    Args:
        name: Its name.
        from_m: Height at which it begins.
        to_m: Height at which it ends.
        frame_origin_m: Origin of its frame.
        frame_quaternion: Orientation of its frame (w, x, y, z).
    """

    name: str
    from_m: float
    to_m: float
    frame_origin_m: Vector
    frame_quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class Segment(Message):
    """A soft segment at rest.

    Args:
        name: Its name.
        from_m: Height at which it begins.
        to_m: Height at which it ends.
    """

    name: str
    from_m: float
    to_m: float


class Marker(Message):
    """A marker of the motion capture.

    Args:
        name: Its name.
        section: Section that carries it.
    """

    name: str
    section: str


class Chamber(Message):
    """A pressure chamber at rest.

    Args:
        azimuth_rad: Direction of its centre about z.
        from_m: Height at which it begins.
        to_m: Height at which it ends.
        pressure_limit_pa: Largest safe gauge pressure.
    """

    azimuth_rad: float
    from_m: float
    to_m: float
    pressure_limit_pa: float


class Body(Message):
    """Sections and chambers of an arm.

    Args:
        gravity_m_s2: Gravitational acceleration in the base frame.
        sections: Rigid sections, from base to tip.
        chambers: Chambers, in the order of their index.
        segments: Soft segments, from base to tip.
        markers: Markers of the motion capture.
    """

    gravity_m_s2: Vector = (0.0, 0.0, 9.81)
    sections: tuple[RigidSection, ...]
    chambers: tuple[Chamber, ...] = ()
    segments: tuple[Segment, ...] = ()
    markers: tuple[Marker, ...] = ()

    @property
    def pressure_limits_pa(self) -> tuple[float, ...]:
        """Largest safe gauge pressure of each chamber [Pa]."""
        return tuple(chamber.pressure_limit_pa for chamber in self.chambers)

    @property
    def hangs(self) -> bool:
        """Whether gravity points from the base to the tip."""
        return self.gravity_m_s2[2] > 0.0
