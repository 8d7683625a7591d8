"""The 3-D view: the arm's surface coloured by stress, and the force with its uncertainty."""

import threading
from collections.abc import Sequence

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from softarm_client.messages import LoadEstimate, SectionPose, Surface

Floats = NDArray[np.float64]
METRES_PER_NEWTON = 0.15
HANGING = np.diag([1.0, -1.0, -1.0])
"""The view's z points up, the base frame's from the base down to the tip."""
GREY = (150, 150, 150)
COLD, HOT = np.array([70.0, 130.0, 200.0]), np.array([225.0, 70.0, 50.0])


def colours(stress: Floats) -> NDArray[np.uint8]:
    """Colour nodes from blue at no stress to red at the 98th percentile, shape (nodes, 3)."""
    top = float(np.percentile(stress, 98.0))
    share = np.clip(stress / top, 0.0, 1.0)[:, None] if top > 0.0 else np.zeros((len(stress), 1))
    return np.asarray((1.0 - share) * COLD + share * HOT, dtype=np.uint8)


def load_deviation(load: LoadEstimate) -> float:
    """Return the standard deviation of a force, root mean square over its estimated axes [N]."""
    variances = [row[axis] for axis, row in enumerate(load.covariance_n2)]
    known = [variance for variance in variances if variance is not None]
    return float(np.sqrt(max(sum(known) / len(known), 0.0))) if known else 0.0


class ArmScene:
    """What the browser shows in 3-D.

    Args:
        server: viser's server.
        surface: The arm's surface at rest.
    """

    def __init__(self, server: viser.ViserServer, surface: Surface) -> None:
        rest = np.array(surface.rest_m)
        self._server = server
        self._nodes = len(rest)
        self._faces = np.array(surface.triangles)
        server.scene.set_up_direction("+z")
        server.scene.add_grid("/floor", width=0.6, height=0.6, position=(0.0, 0.0, -0.35), cell_size=0.05)
        server.initial_camera.position = (0.45, -0.45, 0.05)
        server.initial_camera.look_at = (0.0, 0.0, -0.14)
        self._force_handles: dict[str, viser.SceneNodeHandle] = {}
        self._shown = rest, np.zeros(self._nodes)
        self._stale = False
        self._drawing = threading.Lock()
        self._draw()

    def _draw(self) -> None:
        points, stress = self._shown
        vertices = points @ HANGING.T
        painted = np.full((len(vertices), 3), GREY, np.uint8) if self._stale else colours(stress)
        surface = trimesh.Trimesh(vertices, self._faces, vertex_colors=painted, process=False)
        self._server.scene.add_mesh_trimesh("/arm", surface)

    def show_stale(self, stale: bool) -> None:
        """Draw the arm grey and without forces while the service is not heard."""
        with self._drawing:
            if stale == self._stale:
                return
            self._stale = stale
            self._draw()
            for handle in self._force_handles.values():
                handle.visible = not stale

    def show_shape(self, data: bytes) -> None:
        """Show a shape message: positions and stress of every node of the surface."""
        nodes = np.frombuffer(data, dtype="<f4").reshape(-1, 4).astype(np.float64)
        if len(nodes) == self._nodes:
            with self._drawing:
                self._shown = nodes[:, :3], nodes[:, 3]
                self._draw()

    def show_loads(self, loads: Sequence[LoadEstimate], sections: Sequence[SectionPose]) -> None:
        """Draw each force as an arrow at its section, with a sphere of one standard deviation at its head."""
        places = {section.section: np.array(section.position_m) for section in sections}
        with self._drawing:  # show_stale must not meet an arrow that is being replaced
            for load in loads:
                place = places.get(load.section)
                if place is None:
                    continue
                start = place @ HANGING.T
                reach = METRES_PER_NEWTON * np.array(load.force_n) @ HANGING.T
                deviation = load_deviation(load)
                self._force_handles[f"/force/{load.section}"] = self._server.scene.add_arrows(
                    f"/force/{load.section}",
                    np.array([[start, start + reach]], dtype=np.float32),
                    colors=(240, 170, 40),
                    shaft_radius=0.002,
                    head_radius=0.005,
                    head_length=0.012,
                )
                self._force_handles[f"/uncertainty/{load.section}"] = self._server.scene.add_icosphere(
                    f"/uncertainty/{load.section}",
                    radius=max(METRES_PER_NEWTON * deviation, 1e-4),
                    color=(240, 170, 40),
                    opacity=0.3,
                    position=tuple(start + reach),
                )
