"""Addresses in compiled kernels: an array is released after its last use, and an address is no use of it."""

import ast
from pathlib import Path

import pytest

from softarm.estimator import fem

ALLOCATIONS = {"empty", "zeros", "full", "ones", "empty_like", "zeros_like"}
KERNELS = [path for path in Path(fem.__file__).parent.rglob("*.py") if ".ctypes.data" in path.read_text()]


def allocated(function):
    """Collect the names of arrays that a function allocates itself."""
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            for target, value in zip(targets, values, strict=False):
                call = value.func if isinstance(value, ast.Call) else None
                if (
                    isinstance(target, ast.Name)
                    and isinstance(call, ast.Attribute)
                    and call.attr in ALLOCATIONS
                ):
                    names.add(target.id)
    return names


def addressed(node):
    """Return the name of the array whose address an expression takes, None for any other expression."""
    if not (
        isinstance(node, ast.Attribute) and node.attr == "data" and isinstance(node.value, ast.Attribute)
    ):
        return None
    array = node.value.value
    while isinstance(array, ast.Subscript):
        array = array.value
    return array.id if isinstance(array, ast.Name) and node.value.attr == "ctypes" else None


def addresses_outside_loops(function):
    """Find the arrays of a function whose address is taken outside any loop.

    Inside a loop the next iteration takes it again, so that the array lives until the loop ends.
    """
    in_loops = {
        id(node) for loop in ast.walk(function) if isinstance(loop, ast.For) for node in ast.walk(loop)
    }
    taken = {addressed(node) for node in ast.walk(function) if id(node) not in in_loops}
    return taken & allocated(function)


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.stem)
def test_arrays_outlive_their_addresses(path):
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    assert {f.name: found for f in functions if (found := addresses_outside_loops(f))} == {}


def test_an_address_outside_a_loop_is_found():
    lines = (
        "def kernel():",
        " work = np.empty(9)",
        " at = work.ctypes.data",
        " for i in range(3):",
        "  f(at)",
    )
    source = "\n".join(lines)
    assert addresses_outside_loops(ast.parse(source).body[0]) == {"work"}
