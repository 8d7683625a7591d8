"""Small bodies that the tests of the finite elements share."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from acceptance.verification.box import box, with_nodes, with_surface
from softarm.estimator.fem import FiniteElementModel, Material, Membrane
from softarm.estimator.mesh import ElementKind, Mesh
from softarm.estimator.model import Load

WIDTH, LENGTH = 0.04, 0.12
LOADS = (
    Load("tip_x", "force", (1.0, 0.0, 0.0), "tip"),
    Load("tip_twist", "moment", (0.0, 0.0, 1.0), "tip"),
    Load("mid_y", "force", (0.0, 1.0, 0.0), height=0.05),
)


def hollow_arm(kind: ElementKind, layers: int = 3) -> Mesh:
    """A square bar around one closed chamber, clamped at z = 0."""
    mesh = box(kind, (3, 3, layers), (WIDTH, WIDTH, LENGTH))
    block = mesh.blocks[0]
    corners = 4 if kind.startswith("tet") else 8
    centre = mesh.points[block.connectivity[:, :corners]].mean(axis=1)
    inside = np.abs(centre - [WIDTH / 2, WIDTH / 2, LENGTH / 2]) < np.array(
        [WIDTH / 6, WIDTH / 6, LENGTH / 2 - LENGTH / layers]
    )
    keep = ~inside.all(axis=1)
    block = replace(block, connectivity=block.connectivity[keep], region=block.region[keep])
    mesh = replace(mesh, blocks=(block,))
    margin = 1e-4
    mesh = with_surface(
        mesh,
        "chamber_0",
        lambda x: ((x > margin) & (x < np.array([WIDTH, WIDTH, LENGTH]) - margin)).all(axis=1),
    )
    mesh = with_nodes(mesh, "clamp", lambda x: x[:, 2] < 1e-9)
    return with_nodes(mesh, "section_tip", lambda x: x[:, 2] > LENGTH - 1e-9)


def _model(
    kind: ElementKind, law: str = "neo_hookean", layers: int = 3, stiffness: float = 5e3
) -> FiniteElementModel:
    """The hollow arm with fibres, a tip section and three loads."""
    shape = (50.0, 0.0) if law == "gent" else (0.2, 0.3)
    return FiniteElementModel.build(
        hollow_arm(kind, layers),
        {"body": Material(law, 300e3, 0.45, 1000.0, shape)},
        fibres=[Membrane("chamber_0", stiffness)],
        sections=["tip"],
        loads=LOADS,
    )


@pytest.fixture
def arm_of() -> Callable[..., FiniteElementModel]:
    return _model
