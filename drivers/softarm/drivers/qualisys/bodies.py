"""Rigid bodies in a data packet: the 6D family of components."""

import struct
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softarm.drivers.framing import FrameFault


class Component(IntEnum):
    """The components that carry rigid bodies."""

    SIX_D = 5
    SIX_D_EULER = 6
    SIX_D_RESIDUAL = 11
    SIX_D_EULER_RESIDUAL = 12


WIDTHS: Final[dict[int, int]] = {
    Component.SIX_D: 12,
    Component.SIX_D_EULER: 6,
    Component.SIX_D_RESIDUAL: 13,
    Component.SIX_D_EULER_RESIDUAL: 7,
}
"""Numbers per body."""

_FLOAT: Final = np.dtype("<f4")
_FIRST: Final = struct.Struct("<qIIIIIhh").unpack_from
_COMPONENT: Final = struct.Struct("<IIIhh").unpack_from
_DATA_START: Final = 8
_COMPONENTS_START: Final = 24
_BODIES_OFFSET: Final = 16
_SMALLEST: Final = _COMPONENTS_START + _BODIES_OFFSET
_array = np.ndarray
_new = tuple.__new__  # a named tuple's own constructor costs twice as much


class BodyFrame(NamedTuple):
    """The bodies of one data packet, as sent.

    Attributes:
        timestamp_us: Time since the measurement began [us].
        frame: Frame number.
        component: Which of `Component`.
        drop_rate: Missing two-dimensional data of the last second [per mille].
        out_of_sync_rate: Late two-dimensional data of the last second [per mille].
        values: One row per body: position [mm]; rotation matrix column by column, or three angles [degree];
            then the residual [mm] in the kinds that have one. All bits of a lost body are set, which reads as
            NaN.
    """

    timestamp_us: int
    frame: int
    component: int
    drop_rate: int
    out_of_sync_rate: int
    values: NDArray[np.float32]


def decode_bodies(packet: bytes) -> BodyFrame | FrameFault | None:
    """Return the bodies of a data packet with its header, None if it carries none, or what is wrong with it.

    The usual packet has the bodies as its first component and is read in one go; others are searched.
    """
    if len(packet) < _SMALLEST:
        return _search(packet)
    timestamp, frame, _, size, kind, bodies, drop_rate, out_of_sync = _FIRST(packet, _DATA_START)
    width = WIDTHS.get(kind)
    if width is None:
        return _search(packet)
    # The count comes from the wire: it must fit the component before it sizes an array.
    if size != _BODIES_OFFSET + 4 * bodies * width or _COMPONENTS_START + size > len(packet):
        return FrameFault("component", f"{bodies} bodies of kind {kind} in a component of {size} bytes")
    values = _array((bodies, width), _FLOAT, packet, _SMALLEST)
    return _new(BodyFrame, (timestamp, frame, kind, drop_rate, out_of_sync, values))


def _search(packet: bytes) -> BodyFrame | FrameFault | None:
    """Go through all components."""
    if len(packet) < _COMPONENTS_START:
        return FrameFault("data", f"a data packet of {len(packet)} bytes")
    timestamp, frame, components = struct.unpack_from("<qII", packet, _DATA_START)
    at = _COMPONENTS_START
    for _ in range(components):
        if at + 8 > len(packet):
            return FrameFault("component", f"{components} components do not fit {len(packet)} bytes")
        size, kind = struct.unpack_from("<II", packet, at)
        if size < 8 or at + size > len(packet):
            return FrameFault("component", f"a component of {size} bytes at byte {at} of {len(packet)}")
        if kind in WIDTHS:
            return _component(packet, at, size, timestamp, frame)
        at += size
    return None


def _component(packet: bytes, at: int, size: int, timestamp: int, frame: int) -> BodyFrame | FrameFault:
    if size < _BODIES_OFFSET:
        return FrameFault("component", f"a component of {size} bytes cannot hold bodies")
    _, kind, bodies, drop_rate, out_of_sync = _COMPONENT(packet, at)
    width = WIDTHS[kind]
    if size != _BODIES_OFFSET + 4 * bodies * width:
        return FrameFault("component", f"{bodies} bodies of kind {kind} in a component of {size} bytes")
    values = _array((bodies, width), _FLOAT, packet, at + _BODIES_OFFSET)
    return BodyFrame(timestamp, frame, kind, drop_rate, out_of_sync, values)
