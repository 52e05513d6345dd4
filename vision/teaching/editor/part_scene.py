"""The part in 3D: its taught circles, the bore, and the gripper's fingers at the grasps (Fig. 2 b)."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import partial

import numpy as np
from nicegui import ui
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.geometry.circle import Circle, plane_axes
from vision.teaching.document import Document
from vision.teaching.editor.findings import Finding
from vision.teaching.events import PlaceGrasp, SetBore, pose_of

Array = NDArray[np.float64]

SIZE = 10.0  # of the part's diameter in the scene's units
GRIPPER, GRIPPER_CHOSEN = "#5c6b7c", "#ffd166"
FAINT, FAINTEST = 0.12, 0.06  # other grasps, and the other copies of the chosen one
AXES = (("#ff6b6b", (1, 0, 0)), ("#56d364", (0, 1, 0)), ("#4c8dff", (0, 0, 1)))


class PartScene:
    """Draws a document; the person turns and zooms it with the mouse."""

    def __init__(self) -> None:
        """An empty scene."""
        with ui.element("div").classes("teach-scene"):
            self._scene = ui.scene(grid=False, background_color="#0b1016", fps=30)
            self._scene.move_camera(x=5.5, y=-9.5, z=8, look_at_x=0, look_at_y=0, look_at_z=0, duration=0)
            self._scene.on("init", self.fit)
            ui.label("Drag to turn, wheel to zoom, right button to move").classes("teach-hint")
        self._drawn: dict[Hashable, ui.scene.group] = {}

    def fit(self) -> None:
        """Take the room there is; needed once it is in sight."""
        self._scene.run_method("resize")

    def show(
        self, document: Document, findings: Sequence[Finding], colours: dict[str, str], chosen: str | None
    ) -> None:
        """Draw everything; what is drawn already stays."""
        scale = SIZE / self._diameter(document, findings)
        wanted: dict[Hashable, Callable[[], None]] = {("axes",): self._draw_axes}
        for finding in findings:
            if finding.circle is not None:
                colour = colours[finding.feature.feature_id]
                key = (*_rounded(finding.circle), finding.feature.copies, colour, scale)
                wanted[key] = partial(self._draw_circles, finding.circle, finding.feature.copies, colour, scale)
        if document.bore is not None:
            wanted[document.bore, scale] = partial(self._draw_bore, document.bore, scale)
        for grasp in document.grasps:
            is_chosen = grasp.grasp_id == chosen
            wanted[grasp, is_chosen, scale] = partial(self._draw_gripper, grasp, scale, is_chosen)
        self._draw(wanted)

    def _draw(self, wanted: dict[Hashable, Callable[[], None]]) -> None:
        with self._scene as scene:
            for key in [key for key in self._drawn if key not in wanted]:
                self._drawn.pop(key).delete()
            for key in [key for key in wanted if key not in self._drawn]:
                with scene.group() as group:
                    wanted[key]()
                self._drawn[key] = group

    def _diameter(self, document: Document, findings: Sequence[Finding]) -> float:
        largest = max((2 * f.circle.radius_m for f in findings if f.circle is not None), default=0.1)
        return document.diameter_m or largest

    def _draw_axes(self) -> None:
        for colour, direction in AXES:
            end = [0.16 * SIZE * d for d in direction]
            self._scene.line([0, 0, 0], end).material(colour)

    def _draw_circles(self, circle: Circle, copies: int, colour: str, scale: float) -> None:
        thickness = max(0.006 * SIZE, 0.02 * scale * circle.radius_m)
        radius = scale * circle.radius_m
        for k in range(copies):
            a = 2 * np.pi * k / copies
            turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
            centre, normal = scale * turn @ circle.centre, turn @ circle.normal
            ring = self._scene.ring(radius - thickness / 2, radius + thickness / 2, theta_segments=72)
            u, v = plane_axes(normal)
            ring.material(colour, 1.0 if k == 0 else 0.55, side="both").move(*centre.tolist())
            ring.rotate_R(np.column_stack([u, v, normal]).tolist())

    def _draw_bore(self, bore: SetBore, scale: float) -> None:
        pose, radius, depth = pose_of(bore.T_part_bore), scale * bore.diameter_m / 2, scale * bore.depth_m
        with self._scene.group() as group:
            _place(group, pose, scale)
            tube = self._scene.cylinder(radius, radius, depth, 48)
            tube.material("#38d9a9", 0.15, side="both").move(0, 0, depth / 2).rotate(np.pi / 2, 0, 0)
            self._scene.line([0, 0, -0.1 * SIZE], [0, 0, depth]).material("#38d9a9")

    def _draw_gripper(self, grasp: PlaceGrasp, scale: float, chosen: bool) -> None:
        """Two fingers, their tips at the tool centre point, and the palm that they come from."""
        colour, opacity = (GRIPPER_CHOSEN, 0.95) if chosen else (GRIPPER, FAINT)
        thick, wide, long = 0.035 * SIZE, 0.09 * SIZE, 0.34 * SIZE
        offset = scale * grasp.width_m / 2 + (thick / 2 if grasp.kind == "outside" else -thick / 2)
        turns = range(grasp.copies if chosen else 1)
        for k in turns:
            a = 2 * np.pi * k / grasp.copies
            turned = RigidTransform.from_matrix(_about_z(a)) * pose_of(grasp.T_part_tcp)
            shade = opacity if k == 0 else FAINTEST
            with self._scene.group() as group:
                _place(group, turned, scale)
                for side in (-1, 1):
                    finger = self._scene.box(thick, wide, long)
                    finger.move(side * offset, 0, -long / 2).material(colour, shade)
                if k == 0:
                    palm = self._scene.box(2 * abs(offset) + 2 * thick, wide, thick)
                    palm.move(0, 0, -long - thick / 2).material(colour, shade)
                    self._scene.line([0, 0, -long], [0, 0, 0]).material(colour)


def _rounded(circle: Circle) -> tuple[float, ...]:
    """A circle to a micrometre, by which it is known again."""
    return (*circle.centre.round(6).tolist(), *circle.normal.round(4).tolist(), round(circle.radius_m, 6))


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def _place(group: ui.scene.group, pose: RigidTransform, scale: float) -> None:
    matrix = pose.as_matrix()
    group.move(*(scale * matrix[:3, 3]).tolist())
    group.rotate_R(matrix[:3, :3].tolist())
