"""The page of the proof is renewed table by table."""

from softarm.bench.trials.page import renewed
from softarm.common.tables import Table

HEAD = "# The proof\n\nSome words.\n"


def test_a_table_takes_the_place_of_its_own_and_leaves_the_others() -> None:
    one, two = Table("One", [{"a": 1}]), Table("Two", [{"b": 2}], ("A note.",))
    page = renewed(HEAD, [one, two])
    assert page.startswith(HEAD.strip())
    again = renewed(page, [Table("One", [{"a": 3}])])
    assert "| 3 |" in again
    assert "| 1 |" not in again
    assert again.index("**One**") < again.index("**Two**")
    assert "A note." in again
    assert renewed(again, [Table("One", [{"a": 1}])]) == page


def test_a_table_that_is_new_comes_last() -> None:
    page = renewed(renewed(HEAD, [Table("One", [{"a": 1}])]), [Table("Three", [{"c": 3}])])
    assert page.index("**One**") < page.index("**Three**")
