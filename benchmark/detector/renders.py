"""Rendered scenes with exactly known ellipses: simple solids under MuJoCo's renderer.

Discs, stacks of coaxial cylinders and spheres of all sizes stand, lie and lean on textured ground among boxes and
wedges, with bars before them. All ellipses follow from the geometry: a circle in space and the camera give a conic.
What counts as seen is decided point by point: nothing is before it, and the clean picture changes across it. Lights
cast no shadows, whose outlines would be ellipses as well.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.detector.contrast import FAINT_CONTRAST, SAMPLES, VISIBLE_CONTRAST, steps_across
from benchmark.detector.solids import GRAIN, Solid, random_block, random_sphere, random_stack
from benchmark.detector.surfaces import TEXTURES, dead_leaves, textured
from benchmark.world import gl
from benchmark.world.sensor import mujoco_quaternion
from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse

Array = NDArray[np.float64]

WIDTH_PX, HEIGHT_PX = 640, 480
_SUPERSAMPLING = 2
_TEXTURE_PX = 1024
_MIN_SEMI_MINOR_PX = 5.0  # of what is asked for, as in the drawings
_RADIUS_PX = (7.0, 110.0)
_RAY_SLACK_M, _OUTWARD = 5e-5, 1e-6
_STRETCH = 15  # samples of an outline over which its contrast is averaged, so that texture alone is none

# A cylinder is drawn as a prism; with so many sides it is less than 0.02 px off in these pictures.
_SCENE = """
<mujoco>
  <visual>
    <global offwidth="{width}" offheight="{height}"/>
    <quality offsamples="4" numslices="256" numstacks="128"/>
    <map znear="0.05" zfar="40"/>
    <headlight ambient="{ambient} {ambient} {ambient}" diffuse="0 0 0" specular="0 0 0"/>
  </visual>
  <statistic extent="1" center="0 0 0"/>
  <asset>
    <texture name="ground" type="2d" file="ground.png"/>
    <texture name="{grain}" type="2d" file="grain.png"/>
    <material name="ground" texture="ground" texuniform="true" texrepeat="{repeat} {repeat}" specular="0"/>
    {assets}
  </asset>
  <worldbody>
    {lights}
    <geom type="plane" size="12 12 0.1" material="ground"/>
    {geoms}
    <camera name="eye" mode="fixed" pos="{eye}" quat="{turn}" fovy="{fovy}"/>
  </worldbody>
</mujoco>
"""


@dataclass(eq=False)
class _Scene:
    """A scene in the making: the camera, and what has been put before it."""

    camera: Camera
    T_world_camera: RigidTransform
    solids: list[Solid] = field(default_factory=list)

    @property
    def eye(self) -> Array:
        return np.array(self.T_world_camera.translation)

    def ground_at(self, pixel: Array) -> tuple[Array, float]:
        """The point (2,) of the ground behind a pixel, and its depth in metres."""
        ray = self.T_world_camera.rotation.as_matrix() @ self.camera.rays(pixel)[0]
        depth = -self.eye[2] / ray[2]
        return (self.eye + depth * ray)[:2], float(depth)

    def has_room(self, solid: Solid) -> bool:
        """Whether a thing is clear of all others: what runs into each other has edges that nobody computed."""
        return all(np.linalg.norm(solid.centre - s.centre) > solid.reach_m + s.reach_m for s in self.solids)


def compose(rng: np.random.Generator, split: str) -> tuple[Array, list[tuple[Ellipse, float, float]]]:
    """A rendered scene.

    Args:
        rng: all randomness comes from here.
        split: decides the textures.

    Returns:
        The picture (480, 640), sharp and without noise, and every ellipse with the share of it that is plain to see,
        and that which is at least faint.

    Raises:
        ResourceError: this machine cannot draw.
    """
    scene = _furnish(rng)
    model = _compile(rng, scene, split)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    view = View(_render(model, data), scene.camera, scene.T_world_camera)
    seen = []
    for circle in (c for solid in scene.solids for c in solid.circles):
        ellipse = project_circle(circle, view)
        if ellipse is not None:
            seen.append((ellipse, *_visible_shares(view, ellipse, _in_sight(model, data, view, ellipse, circle))))
    return view.gray.astype(float), seen


def _furnish(rng: np.random.Generator) -> _Scene:
    """A camera that looks down at round solids and clutter."""
    scene = _Scene(*_viewpoint(rng))
    for i in range(int(rng.integers(5, 16))):
        at, depth = scene.ground_at(rng.uniform(0, 1, 2) * (WIDTH_PX, HEIGHT_PX))
        radius_m = float(np.exp(rng.uniform(*np.log(_RADIUS_PX)))) * depth / scene.camera.fx
        if rng.random() < 0.3:
            solid = random_sphere(rng, f"sphere_{i}", at, radius_m, scene.eye)
        else:
            solid = random_stack(rng, f"stack_{i}", at, radius_m)
        if scene.has_room(solid):
            scene.solids.append(solid)
    targets = list(scene.solids)
    for i in range(int(rng.integers(4, 25))):
        block = _block_on_ground(rng, scene, f"block_{i}")
        if scene.has_room(block):
            scene.solids.append(block)
    for i in range(int(rng.integers(0, 5))):
        if targets:
            bar = _bar_before(rng, scene, targets[int(rng.integers(len(targets)))], f"bar_{i}")
            if scene.has_room(bar):
                scene.solids.append(bar)
    return scene


def _viewpoint(rng: np.random.Generator) -> tuple[Camera, RigidTransform]:
    """A camera that looks at the ground about a metre away, never as flat as to see the horizon."""
    f = float(rng.uniform(700, 1200))
    camera = Camera(WIDTH_PX, HEIGHT_PX, f, f, (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2)
    elevation, azimuth, roll = np.radians([rng.uniform(32, 80), rng.uniform(0, 360), rng.normal(0, 6)])
    back = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    right = np.cross(-back, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    upright = Rotation.from_matrix(np.column_stack([right, np.cross(-back, right), -back]))
    return camera, RigidTransform.from_components(back, upright * Rotation.from_euler("z", roll))


def _block_on_ground(rng: np.random.Generator, scene: _Scene, name: str) -> Solid:
    at, depth = scene.ground_at(rng.uniform(-0.1, 1.1, 2) * (WIDTH_PX, HEIGHT_PX))
    half_sizes = np.exp(rng.uniform(np.log(4), np.log(70), 3)) * depth / scene.camera.fx
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))
    if rng.random() < 0.4:
        turn = turn * Rotation.from_rotvec(rng.normal(0, 0.6, 3))
    height = float(np.abs(turn.as_matrix()[2]) @ half_sizes)
    return random_block(rng, name, np.array([*at, height]), half_sizes, turn)


def _bar_before(rng: np.random.Generator, scene: _Scene, target: Solid, name: str) -> Solid:
    """A slender box in the air that hides a part of a thing."""
    aim = target.centre + rng.uniform(-1, 1, 3) * target.reach_m
    half_sizes = np.array([rng.uniform(0.05, 0.14), rng.uniform(0.004, 0.03), rng.uniform(0.004, 0.03)])
    turn = Rotation.from_euler("zyx", rng.uniform(0, 2 * np.pi, 3))
    return random_block(rng, name, scene.eye + rng.uniform(0.45, 0.7) * (aim - scene.eye), half_sizes, turn)


def _compile(rng: np.random.Generator, scene: _Scene, split: str) -> mujoco.MjModel:
    texture = TEXTURES[split][int(rng.integers(len(TEXTURES[split])))]
    size = (_TEXTURE_PX, _TEXTURE_PX)
    if rng.random() < 0.5:
        ground = dead_leaves(rng, size, int(np.exp(rng.uniform(np.log(8), np.log(80)))), texture)
    else:
        ground = textured(rng, size, rng.uniform(60, 220), rng.uniform(0, 25), texture)
    grain = textured(rng, size, 215.0, rng.uniform(5, 18), texture)
    xml = _SCENE.format(
        width=_SUPERSAMPLING * WIDTH_PX,
        height=_SUPERSAMPLING * HEIGHT_PX,
        ambient=f"{rng.uniform(0.25, 0.5):.3f}",
        grain=GRAIN,
        repeat=f"{rng.uniform(0.7, 1.5):.3f}",
        assets="".join(solid.assets for solid in scene.solids),
        lights=_lights(rng),
        geoms="".join(solid.geoms for solid in scene.solids),
        eye=" ".join(map(repr, scene.eye.tolist())),
        turn=" ".join(map(repr, mujoco_quaternion(scene.T_world_camera).tolist())),
        fovy=repr(float(np.degrees(2 * np.arctan(HEIGHT_PX / 2 / scene.camera.fy)))),
    )
    return mujoco.MjModel.from_xml_string(xml, {"ground.png": _png(ground), "grain.png": _png(grain)})


def _lights(rng: np.random.Generator) -> str:
    """One to three distant lights from above, together about as bright as film can bear."""
    count = int(rng.integers(1, 4))
    strengths = rng.dirichlet(np.ones(count)) * rng.uniform(0.5, 0.9)
    lights = ""
    for strength in strengths:
        x, y = rng.normal(0, 0.8, 2)
        colours = f'diffuse="{strength} {strength} {strength}" specular="{strength} {strength} {strength}"'
        lights += f'<light directional="true" castshadow="false" dir="{x} {y} -1" ambient="0 0 0" {colours}/>\n'
    return lights


def _png(grey: Array) -> bytes:
    _, file = cv2.imencode(".png", np.repeat(np.round(grey).astype(np.uint8)[..., None], 3, axis=2))
    return file.tobytes()


def _render(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.uint8]:
    """(480, 640) the picture, averaged from a larger one."""
    gl.choose_backend()
    height, width = _SUPERSAMPLING * HEIGHT_PX, _SUPERSAMPLING * WIDTH_PX
    with mujoco.Renderer(model, height, width) as renderer:
        renderer.update_scene(data, "eye")
        grey = renderer.render()[..., 1]  # everything is grey
    return np.asarray(cv2.resize(grey, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA))


def _in_sight(
    model: mujoco.MjModel, data: mujoco.MjData, view: View, ellipse: Ellipse, circle: Circle
) -> NDArray[np.bool_]:
    """At which of ``SAMPLES`` points of an ellipse nothing lies before the circle that it is the image of.

    The points are taken a trifle outside of the circle: a ray to the rim itself grazes it, hitting it or not.
    """
    plane = circle.moved(view.T_world_camera.inv())
    points = view.camera.rays(ellipse.sample(SAMPLES))
    points *= (plane.normal @ plane.centre / (points @ plane.normal))[:, None]
    points += _OUTWARD * (points - plane.centre)
    R = view.T_world_camera.rotation.as_matrix()
    eye = np.array(view.T_world_camera.translation)
    clear, geom = np.zeros(SAMPLES, bool), np.zeros(1, np.int32)
    for i, ray in enumerate(points @ R.T):
        distance = float(np.linalg.norm(ray))
        hit = mujoco.mj_ray(model, data, eye, ray / distance, None, 1, -1, geom)
        clear[i] = hit < 0 or hit > distance - _RAY_SLACK_M
    return clear


def _visible_shares(view: View, ellipse: Ellipse, in_sight: NDArray[np.bool_]) -> tuple[float, float]:
    """Shares of an ellipse that are in sight with a contrast that everyone sees, and with a faint one.

    Ellipses narrower than those of the drawings are never plain to see.
    """
    step = np.abs(uniform_filter1d(steps_across(view.gray.astype(float), ellipse), _STRETCH, mode="wrap"))
    visible, faint = (float(np.mean(in_sight & (step >= c))) for c in (VISIBLE_CONTRAST, FAINT_CONTRAST))
    return (visible if ellipse.semi_axes[1] >= _MIN_SEMI_MINOR_PX else 0.0), faint
