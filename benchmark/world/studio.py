"""The teaching fixture: one isolated part, photographed from five directions on either face."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.world import gl
from benchmark.world.sensor import SensorConfig, capture, mujoco_quaternion
from vision.geometry.camera import Camera, View

Array = NDArray[np.float64]

PART_FILLS = 0.75  # share of the picture's height that the part's outline takes
TILTS_RAD = (np.radians(8.0), *[np.radians(27.0)] * 4)
AZIMUTHS_RAD = (np.radians(20.0), *np.radians([45.0, 135.0, 225.0, 315.0]))

# Diffuse light, as in a dome: it makes a chamfer nearly as bright as its face. In hard light a chamfer is dark, and
# where it is narrower than a pixel the edge appears in its middle instead of where the metal ends.
_SCENE = """
<mujoco>
  <option gravity="0 0 0"/>
  <visual>
    <global offwidth="{width}" offheight="{height}"/>
    <quality shadowsize="1024" offsamples="4"/>
    <map znear="0.05" zfar="40"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0 0 0" specular="0 0 0"/>
  </visual>
  <statistic extent="{extent}" center="0 0 0"/>
  <asset>
    <mesh name="part" file="part.obj"/>
    <material name="part" rgba="{rgba}" specular="0.15" shininess="0.5"/>
  </asset>
  <worldbody>
    <light dir="0.35 0.2 -1" directional="true" castshadow="false" diffuse="0.3 0.3 0.3" specular="0.1 0.1 0.1"/>
    <light dir="-0.35 -0.2 -1" directional="true" castshadow="false" diffuse="0.3 0.3 0.3" specular="0.1 0.1 0.1"/>
    <geom type="plane" size="5 5 0.1" pos="0 0 {floor}" rgba="0.19 0.20 0.22 1"/>
    <body name="part" mocap="true"><geom type="mesh" mesh="part" material="part"/></body>
    <camera name="eye" mode="fixed" focal="{focal} {focal}" sensorsize="{sensor}" resolution="{width} {height}"/>
  </worldbody>
</mujoco>
"""


@dataclass(frozen=True, eq=False)
class Sitter:
    """What stands on the fixture.

    Attributes:
        mesh: OBJ or STL file in metres, in the part's frame.
        diameter_m: outline diameter.
        rgba: colour.
    """

    mesh: Path
    diameter_m: float
    rgba: tuple[float, float, float, float]


class Studio:
    """Photographs one part. Holds an OpenGL context: close it, or use it in a `with` block."""

    def __init__(self, sitter: Sitter, focal_length_m: float = 0.016) -> None:
        """Compile the fixture.

        Args:
            sitter: the part.
            focal_length_m: of the lens on the 1/3-inch sensor.
        """
        gl.choose_backend()
        self._sitter = sitter
        self.camera = Camera.from_lens(focal_length_m, (0.0048, 0.0036), (640, 480))
        self.distance_m = sitter.diameter_m * self.camera.fy / (PART_FILLS * self.camera.height_px)
        xml = _SCENE.format(
            width=self.camera.width_px,
            height=self.camera.height_px,
            rgba=" ".join(map(str, sitter.rgba)),
            extent=1.5 * sitter.diameter_m,
            floor=-0.8 * sitter.diameter_m,
            focal=focal_length_m,
            sensor="0.0048 0.0036",
        )
        self._model = mujoco.MjModel.from_xml_string(xml, {"part.obj": sitter.mesh.read_bytes()})
        self._data = mujoco.MjData(self._model)
        self._renderer = mujoco.Renderer(self._model, self.camera.height_px, self.camera.width_px)

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._renderer.close()

    def photograph(self, sensor: SensorConfig, seed: int) -> list[View]:
        """Five views of the front and, with the part turned over, five of the back.

        The views' world frame is the part's frame: the fixture knows how the part stands on it.
        """
        rng = np.random.default_rng(seed)
        turned_over = RigidTransform.from_rotation(Rotation.from_euler("x", np.pi))
        views = []
        for face, T_world_part in (("front", RigidTransform.identity()), ("back", turned_over)):
            self._stand(T_world_part)
            for number, (tilt, azimuth) in enumerate(zip(TILTS_RAD, AZIMUTHS_RAD, strict=True), start=1):
                T_world_camera = _look_at_origin(float(tilt), float(azimuth), self.distance_m)
                image = capture(self._render(T_world_camera), rng, sensor)
                views.append(View(image, self.camera, T_world_part.inv() * T_world_camera, f"{face} {number}"))
        return views

    def sees(self, view: View, points: Array) -> NDArray[np.bool_]:
        """Which points (N, 3) of the part's surface, in the part's frame, nothing hides from the view's camera."""
        self._stand(RigidTransform.identity())
        eye = view.T_world_camera.translation
        clear = np.zeros(len(points), bool)
        geom = np.zeros(1, np.int32)
        for i, point in enumerate(points):
            ray = point - eye
            distance = float(np.linalg.norm(ray))
            hit = mujoco.mj_ray(self._model, self._data, eye, ray / distance, None, 1, -1, geom)
            clear[i] = hit < 0 or hit > distance - 2e-3 * self._sitter.diameter_m
        return clear

    def _stand(self, T_world_part: RigidTransform) -> None:
        self._data.mocap_pos[0] = T_world_part.translation
        self._data.mocap_quat[0] = T_world_part.rotation.as_quat(scalar_first=True)
        mujoco.mj_forward(self._model, self._data)

    def _render(self, T_world_camera: RigidTransform) -> NDArray[np.uint8]:
        self._model.cam_pos[0] = T_world_camera.translation
        self._model.cam_quat[0] = mujoco_quaternion(T_world_camera)
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, "eye")
        return np.asarray(self._renderer.render())


def _look_at_origin(tilt_rad: float, azimuth_rad: float, distance_m: float) -> RigidTransform:
    """T_world_camera that looks at the origin from a direction tilted off the vertical."""
    direction = np.array(
        [
            np.sin(tilt_rad) * np.cos(azimuth_rad),
            np.sin(tilt_rad) * np.sin(azimuth_rad),
            np.cos(tilt_rad),
        ]
    )
    z = -direction
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform.from_components(
        direction * distance_m, Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    )
