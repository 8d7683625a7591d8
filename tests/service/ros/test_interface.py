"""Names of the interface, and the page that documents it."""

from pathlib import Path

import pytest

from softarm_client.ros.interface import ros_name, tables

PAGE = Path(__file__).parents[3] / "docs" / "ros.md"


def test_the_page_has_the_tables_of_the_interface():
    assert tables() in PAGE.read_text("utf-8"), "run: python -m softarm_client.ros.interface"


@pytest.mark.parametrize(
    ("name", "allowed"),
    [("sopra", "sopra"), ("left-arm", "left_arm"), ("2nd arm", "_2nd_arm"), ("größe", "gr__e")],
)
def test_names_are_those_that_ros_takes(name, allowed):
    assert ros_name(name) == allowed
