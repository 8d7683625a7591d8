"""From what QTM sends to poses, and what its settings say of them."""

import struct
from math import cos, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from softarm.drivers.framing import FrameFault
from softarm.drivers.qualisys.bodies import BodyFrame, Component
from softarm.drivers.qualisys.parameters import Parameters, parse_parameters
from softarm.drivers.qualisys.poses import BodyPose, poses, quaternion_from_angles, quaternion_from_columns

Matrix = NDArray[np.float64]
ALL_BITS = struct.unpack("<f", b"\xff" * 4)[0]


def matrix(q: tuple[float, ...]) -> Matrix:
    w, v = q[0], np.array(q[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross)


def about(axis: int, degrees: float) -> Matrix:
    c, s = cos(radians(degrees)), sin(radians(degrees))
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def frame(component: int, rows: list[list[float]]) -> BodyFrame:
    return BodyFrame(0, 1, component, 0, 0, np.array(rows, dtype="<f4"))


angles = st.floats(-180, 180)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(angles, angles, angles)
def test_a_rotation_matrix_and_its_quaternion(roll: float, pitch: float, yaw: float) -> None:
    rotation = about(0, roll) @ about(1, pitch) @ about(2, yaw)
    columns = rotation.T.ravel().tolist()
    for quaternion in (quaternion_from_columns(columns), quaternion_from_angles(roll, pitch, yaw)):
        assert quaternion is not None
        assert quaternion[0] >= 0
        assert sqrt(sum(x * x for x in quaternion)) == pytest.approx(1, abs=1e-12)
        assert matrix(quaternion) == pytest.approx(rotation, abs=1e-9)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns(axis: int) -> None:
    quaternion = quaternion_from_columns(about(axis, 180).T.ravel().tolist())
    assert quaternion is not None
    assert matrix(quaternion) == pytest.approx(about(axis, 180), abs=1e-12)


def test_poses_are_in_metres_and_columns_are_columns() -> None:
    turned = about(2, 30).T.ravel().tolist()
    (pose,) = poses(frame(Component.SIX_D_RESIDUAL, [[100, -50, 25, *turned, 0.4]]))
    assert pose is not None
    assert pose.position == pytest.approx((0.1, -0.05, 0.025))
    assert pose.residual == pytest.approx(0.4e-3)
    assert pose.quaternion == pytest.approx((cos(radians(15)), 0, 0, sin(radians(15))), abs=1e-6)
    (same,) = poses(frame(Component.SIX_D_EULER_RESIDUAL, [[100, -50, 25, 0, 0, 30, 0.4]]))
    assert isinstance(same, BodyPose)
    assert same.quaternion == pytest.approx(pose.quaternion, abs=1e-6)


def test_lost_and_scrambled_bodies_have_no_pose() -> None:
    identity = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]
    mirrored = [1.0, 0, 0, 0, 1, 0, 0, 0, -1]
    rows = [
        [1.0, 2, 3, *identity],
        [ALL_BITS] * 12,
        [float("nan"), 2, 3, *identity],
        [1.0, float("inf"), 3, *identity],
        [1.0, 2, 3, *mirrored],
        [1.0, 2, 3, *([0.0] * 9)],
        [1.0, 2, 3, *(2 * x for x in identity)],
        [1.0, 2, 3, *identity[:8], float("nan")],
    ]
    found = poses(frame(Component.SIX_D, rows))
    assert found[0] is not None
    assert found[1:] == [None] * 7
    assert poses(frame(Component.SIX_D_EULER, [[ALL_BITS] * 6, [1, 2, 3, 4, 5, float("inf")]])) == [
        None,
        None,
    ]


OLD = """<QTM_Parameters_Ver_1.19><General><Frequency>100</Frequency></General>
<The_6D><Bodies>2</Bodies>
<Body><Name>base</Name><RGBColor>255</RGBColor><Point><X>1</X><Y>2</Y><Z>3</Z></Point></Body>
<Body><Name>tip</Name></Body>
<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler></The_6D></QTM_Parameters_Ver_1.19>"""
NEW = """<?xml version="1.0"?><QTM_Parameters_Ver_1.25><General><Frequency>200</Frequency>
<EulerAngles First="Roll" Second="Pitch" Third="Yaw"/></General>
<The_6D><Body><Name>base</Name><Enabled>true</Enabled><Color R="1" G="2" B="3"/></Body>
<Body><Name>spare</Name><Enabled>false</Enabled></Body>
<Body><Name>tip</Name><Points><Point X="1" Y="2" Z="3" Name="p1"/></Points></Body></The_6D>
</QTM_Parameters_Ver_1.25>"""


def test_settings_of_both_layouts() -> None:
    old, new = parse_parameters(OLD), parse_parameters(NEW)
    euler = ("Roll", "Pitch", "Yaw")
    assert old == Parameters(("base", "tip"), ("base", "tip"), euler, 100.0)
    assert new == Parameters(("base", "spare", "tip"), ("base", "tip"), euler, 200.0)


def test_the_count_of_bodies_decides_whether_disabled_ones_are_in_the_data() -> None:
    parameters = parse_parameters(NEW)
    assert isinstance(parameters, Parameters)
    assert parameters.names(2) == ("base", "tip")
    assert parameters.names(3) == ("base", "spare", "tip")
    assert parameters.names(4) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<a>",
        "<other/>",
        "<!DOCTYPE a [<!ENTITY b 'c'>]><QTM_Parameters_Ver_1.25/>",
        OLD.replace("tip", "base"),
        OLD.replace("<Name>tip</Name>", ""),
        "\x00",
    ],
)
def test_settings_that_cannot_be_used(text: str) -> None:
    assert isinstance(parse_parameters(text), FrameFault)


def test_settings_without_bodies() -> None:
    assert parse_parameters("<QTM_Parameters_Ver_1.25/>") == Parameters((), ())


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_any_damage_to_settings(data: st.DataObject) -> None:
    text = list(NEW)
    for _ in range(data.draw(st.integers(1, 5))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.characters())
    assert isinstance(parse_parameters("".join(text)), Parameters | FrameFault)
