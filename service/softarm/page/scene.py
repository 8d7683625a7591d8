"""The 3-D view: the arm coloured by stress, its sections, the forces, the contact and a saved pose."""

import threading
from collections.abc import Sequence

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from viser.transforms import SO3

from softarm.estimator.arrays import Floats
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.body import Chamber
from softarm.page.readings import COLOURS, load_deviation
from softarm_client.messages import Contact, LoadEstimate, SectionPose, Surface

METRES_PER_NEWTON = 0.15
LAYER_M = 2e-3
"""Nodes whose heights at rest differ by less belong to one layer of the surface."""
LABEL_GAP_M = 8e-3
HANGING, STANDING = (0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
"""Orientation of the base frame, whose z points from the base to the tip, in the view, whose z points up."""
GREY = (150, 150, 150)
COLD, HOT = np.array([70.0, 130.0, 200.0]), np.array([225.0, 70.0, 50.0])


def red_stress(stress: Floats) -> float:
    """Return the stress from which nodes are red: the 98th percentile [Pa]."""
    return float(np.percentile(stress, 98.0))


def colours(stress: Floats) -> NDArray[np.uint8]:
    """Colour nodes from blue at no stress to red, shape (nodes, 3)."""
    top = red_stress(stress) or float(stress.max())
    share = np.clip(stress / top, 0.0, 1.0)[:, None] if top > 0.0 else np.zeros((len(stress), 1))
    return np.asarray((1.0 - share) * COLD + share * HOT, dtype=np.uint8)


class ArmScene:
    """What the browser shows in 3-D; every node below ``/base`` is drawn in the base frame.

    Args:
        server: viser's server.
        surface: The arm's surface at rest.
        specimen: The arm.
    """

    def __init__(self, server: viser.ViserServer, surface: Surface, specimen: Specimen) -> None:
        self._rest = np.array(surface.rest_m)
        self._scene = server.scene
        self._faces = np.array(surface.triangles)
        length = float(self._rest[:, 2].max())
        hangs = specimen.gravity_m_s2[2] > 0.0
        middle, floor = (-0.5 * length, -1.25 * length) if hangs else (0.5 * length, 0.0)
        self._scene.set_up_direction("+z")
        self._scene.configure_default_lights(cast_shadow=False)
        self._scene.add_grid("/floor", width=0.6, height=0.6, position=(0.0, 0.0, floor), cell_size=0.05)
        server.initial_camera.position = (1.2 * length, -0.9 * length, middle + 0.4 * length)
        server.initial_camera.look_at = (0.0, 0.0, middle)
        orientation = HANGING if hangs else STANDING
        self._scene.add_frame("/base", wxyz=orientation, axes_length=0.05, axes_radius=0.001)
        self._live = self._scene.add_frame("/base/live", show_axes=False)
        self._sections = {
            section.name: self._scene.add_frame(
                f"/base/section/{section.name}",
                axes_length=0.035,
                axes_radius=0.001,
                wxyz=section.frame_quaternion,
                position=section.frame_origin_m,
            )
            for section in specimen.sections
        }
        for index, chamber in enumerate(specimen.chambers):
            self._label_chamber(index, chamber, specimen)
        self._balls: dict[str, viser.IcosphereHandle] = {}
        self._shown = self._rest, np.zeros(len(self._rest))
        self._stale = False
        self._drawing = threading.Lock()
        self._draw()

    def _label_chamber(self, index: int, chamber: Chamber, specimen: Specimen) -> None:
        """Write a chamber's number beside its beginning, fixed to the section that ends there."""
        section = min(specimen.sections, key=lambda section: abs(section.to_m - chamber.from_m))
        reach = self._radius(self._layer(chamber.from_m), self._rest) + LABEL_GAP_M
        sideways = np.array([np.cos(chamber.azimuth_rad), np.sin(chamber.azimuth_rad), 0.0])
        place = reach * sideways + [0.0, 0.0, chamber.from_m] - np.array(section.frame_origin_m)
        frame = SO3(np.array(section.frame_quaternion))
        self._scene.add_label(
            f"/base/section/{section.name}/chamber-{index}",
            str(index),
            position=frame.inverse().apply(place),
            anchor="center-center",
        )

    def _layer(self, height_m: float) -> NDArray[np.intp]:
        """Return the nodes of the surface that are nearest to a height at rest."""
        distance = np.abs(self._rest[:, 2] - height_m)
        return np.flatnonzero(distance <= distance.min() + LAYER_M)

    @staticmethod
    def _radius(layer: NDArray[np.intp], points: Floats) -> float:
        """Return the largest distance of a layer's nodes from their centre [m]."""
        return float(np.linalg.norm(points[layer] - points[layer].mean(axis=0), axis=1).max())

    def _draw(self) -> None:
        points, stress = self._shown
        painted = np.full((len(points), 3), GREY, np.uint8) if self._stale else colours(stress)
        surface = trimesh.Trimesh(points, self._faces, vertex_colors=painted, process=False)
        self._scene.add_mesh_trimesh("/base/arm", surface)

    @property
    def red_stress_pa(self) -> float:
        """Stress at the red end of the colours [Pa]."""
        return red_stress(self._shown[1])

    def show_stale(self, stale: bool) -> None:
        """Draw the arm grey and without forces while the service is not heard."""
        with self._drawing:
            if stale == self._stale:
                return
            self._stale = stale
            self._live.visible = not stale
            self._draw()

    def show_shape(self, data: bytes) -> None:
        """Show a shape message: positions and stress of every node of the surface."""
        nodes = np.frombuffer(data, dtype="<f4").reshape(-1, 4).astype(np.float64)
        if len(nodes) == len(self._rest):
            self.show_surface(nodes[:, :3], nodes[:, 3])

    def show_surface(self, points: Floats, stress: Floats) -> None:
        """Show the surface: positions [m], shape (nodes, 3), and stress of every node [Pa]."""
        with self._drawing:
            self._shown = points, stress
            self._draw()

    def show_sections(self, sections: Sequence[SectionPose]) -> None:
        """Move the frames of the sections."""
        for section in sections:
            frame = self._sections.get(section.section)
            if frame is not None:
                frame.position, frame.wxyz = section.position_m, section.quaternion_wxyz

    def show_loads(self, loads: Sequence[LoadEstimate], sections: Sequence[SectionPose]) -> None:
        """Draw the forces at their sections."""
        places = {section.section: np.array(section.position_m) for section in sections}
        for index, load in enumerate(loads):
            if load.section in places:
                self._show_load(load, places[load.section], COLOURS[index % len(COLOURS)])

    def _show_load(self, load: LoadEstimate, start: Floats, colour: str) -> None:
        """Draw a force as an arrow, with a sphere of one standard deviation around its head."""
        rgb = _rgb(colour)
        head = start + METRES_PER_NEWTON * np.array(load.force_n)
        self._scene.add_arrows(
            f"/base/live/force/{load.section}",
            np.array([[start, head]], dtype=np.float32),
            colors=rgb,
            shaft_radius=0.002,
            head_radius=0.005,
            head_length=0.012,
        )
        radius = max(METRES_PER_NEWTON * load_deviation(load), 1e-4)
        self._show_ball(f"/base/live/deviation/{load.section}", radius, head, rgb, 0.3)

    def show_contact(self, contact: Contact | None) -> None:
        """Draw a ball around the arm where the contact is."""
        ball = "/base/live/contact"
        if contact is None:
            if ball in self._balls:
                self._balls[ball].visible = False
            return
        layer = self._layer(contact.height_m)
        points, _ = self._shown
        radius = 1.15 * self._radius(layer, points)
        self._show_ball(ball, radius, points[layer].mean(axis=0), (250, 220, 60), 0.35)

    def _show_ball(
        self, name: str, radius: float, centre: Floats, colour: tuple[int, int, int], opacity: float
    ) -> None:
        """Draw a ball, or move the one that is there: a browser draws a new one at the origin first."""
        place = (float(centre[0]), float(centre[1]), float(centre[2]))
        ball = self._balls.get(name)
        if ball is None:
            self._balls[name] = self._scene.add_icosphere(
                name, radius=radius, color=colour, opacity=opacity, position=place
            )
            return
        ball.radius, ball.position, ball.visible = radius, place, True

    def show_note(self, text: str, nodes: NDArray[np.bool_]) -> None:
        """Write a text beside some nodes of the surface; without any nodes there is none.

        Args:
            text: The text.
            nodes: Which nodes, shape (nodes,).
        """
        points, _ = self._shown
        self._scene.add_label(
            "/base/live/note",
            text,
            position=tuple(points[nodes].mean(axis=0)) if nodes.any() else (0.0, 0.0, 0.0),
            anchor="center-left",
            visible=bool(nodes.any()),
        )

    def show_ghost(self, sections: Sequence[SectionPose]) -> None:
        """Draw a saved pose: a grey line through its sections with a frame at each; none removes it."""
        self._scene.add_frame("/base/ghost", show_axes=False, visible=bool(sections))
        if not sections:
            return
        points = np.array([(0.0, 0.0, 0.0), *(section.position_m for section in sections)])
        apart = np.linalg.norm(np.diff(points, axis=0), axis=1) > LAYER_M
        line = points[np.concatenate([[True], apart])]
        self._scene.add_spline_catmull_rom("/base/ghost/line", line, thickness=0.004, color=GREY)
        self._scene.add_batched_axes(
            "/base/ghost/frames",
            np.array([section.quaternion_wxyz for section in sections]),
            np.array([section.position_m for section in sections]),
            axes_length=0.03,
            axes_radius=0.0006,
        )


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue
