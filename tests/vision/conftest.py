"""A plate that can be looked at from anywhere: ray-cast pictures whose every edge is known exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import ndtr

from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle
from vision.model.contour import ModelContour
from vision.model.vision_model import CircleFeature, VisionModel

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
DISTANCE_M = 0.5
BACKGROUND = 30.0
GREYS = {"outline": 170.0, "ring": 115.0, "bore": 50.0, "hole": 60.0}
BLUR_PX = 0.7
HALF_HEIGHT_M = 0.004

Photograph = Callable[..., list[View]]


def _circle(name, role, offset, side, radius, copies=1):
    circle = Circle(np.array([offset, 0.0, side * HALF_HEIGHT_M]), np.array([0.0, 0.0, side]), radius)
    return CircleFeature(name, role, circle, "region", copies)


@pytest.fixture(scope="session")
def plate() -> VisionModel:
    """60 mm across: on the front a ring, a bore and three holes, on the back a wider bore alone."""
    features = (
        _circle("outline_front", "salient", 0.0, 1, 0.030),
        _circle("ring_front", "salient", 0.0, 1, 0.014),
        _circle("bore_front", "salient", 0.0, 1, 0.008),
        _circle("outline_back", "salient", 0.0, -1, 0.030),
        _circle("bore_back", "salient", 0.0, -1, 0.011),
        _circle("hole_front", "supporting", 0.022, 1, 0.0035, copies=3),
    )
    return VisionModel("plate", 0.060, features, symmetry_fold=3)


def look_at_origin(tilt_deg: float, azimuth_deg: float, distance_m: float = DISTANCE_M) -> RigidTransform:
    """T_world_camera of a camera that looks at the world's origin from above."""
    tilt, azimuth = np.radians([tilt_deg, azimuth_deg])
    up = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    x = np.cross(-up, [np.sin(azimuth + 0.3), np.cos(azimuth + 0.3), 0.0])
    x /= np.linalg.norm(x)
    axes = np.column_stack([x, np.cross(-up, x), -up])
    return RigidTransform.from_components(distance_m * up, Rotation.from_matrix(axes))


CAMERA_POSES = tuple(
    look_at_origin(tilt, azimuth) for tilt, azimuth in ((14, 20), (16, 140), (15, 260), (5, 80), (25, 0))
)


def _paint(image: np.ndarray, T_part_camera: np.ndarray, circle: Circle, grey: float) -> None:
    """Fill the circle, its edge blurred: each pixel's ray meets its plane at some distance from its centre."""
    centre = np.linalg.inv(T_part_camera) @ [*circle.centre, 1.0]
    middle = CAMERA.project(centre[:3])[0]
    reach_px = CAMERA.fx * circle.radius_m / (centre[2] - circle.radius_m) + 10
    left, top = np.maximum(middle - reach_px, 0).astype(int)
    right, bottom = np.clip(middle + reach_px, 0, [CAMERA.width_px, CAMERA.height_px]).astype(int)
    if right - left < 2 or bottom - top < 2:
        return
    x, y = np.meshgrid(
        (np.arange(left, right) - CAMERA.cx) / CAMERA.fx, (np.arange(top, bottom) - CAMERA.cy) / CAMERA.fy
    )
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ T_part_camera[:3, :3].T
    eye = T_part_camera[:3, 3]
    reach = (circle.centre[2] - eye[2]) / rays[..., 2]
    hit = eye[:2] + reach[..., None] * rays[..., :2] - circle.centre[:2]
    outside = np.hypot(hit[..., 0], hit[..., 1]) - circle.radius_m
    per_row, per_column = np.gradient(outside)
    covered = ndtr(-outside / np.hypot(per_row, per_column) / BLUR_PX)
    patch = image[top:bottom, left:right]
    patch += covered * (grey - patch)


@pytest.fixture(scope="session")
def photograph(plate: VisionModel) -> Photograph:
    """Pictures of plates at known poses: photograph(poses, views=3, noise=1.0, seed=10_000)."""

    def take(
        poses: Sequence[RigidTransform], views: int | Sequence[int] = 3, noise: float = 1.0, seed: int = 10_000
    ) -> list[View]:
        rng = np.random.default_rng(seed)
        numbers = range(views) if isinstance(views, int) else views
        pictures = []
        for number in numbers:
            T_world_camera = CAMERA_POSES[number]
            image = np.full((CAMERA.height_px, CAMERA.width_px), BACKGROUND)
            for T_world_part in poses:
                T_part_camera = (T_world_part.inv() * T_world_camera).as_matrix()
                side = "front" if T_part_camera[2, 3] > 0 else "back"
                for feature in plate.features:
                    kind, where = feature.name.split("_")
                    for circle in feature.circles() if where == side else ():
                        _paint(image, T_part_camera, circle, GREYS[kind])
            image = np.clip(np.round(image + rng.normal(scale=noise, size=image.shape)), 0, 255)
            pictures.append(View(image.astype(np.uint8), CAMERA, T_world_camera, f"view {number}"))
        return pictures

    return take


@pytest.fixture(scope="session")
def pose() -> Callable[..., RigidTransform]:
    """T_world_part from millimetres and degrees: pose(x, y, z, about=(rx, ry, rz))."""

    def make(x: float = 0.0, y: float = 0.0, z: float = 0.0, about: Sequence[float] = (0, 0, 0)) -> RigidTransform:
        turned = Rotation.from_euler("xyz", about, degrees=True)
        return RigidTransform.from_components(np.array([x, y, z]) * 1e-3, turned)

    return make


@pytest.fixture(scope="session")
def contour(plate: VisionModel) -> ModelContour:
    """The plate's model, sampled coarsely."""
    return ModelContour.of(plate, 1500.0)


@pytest.fixture
def truth(pose: Callable[..., RigidTransform]) -> RigidTransform:
    """A pose of the plate that nothing is special about."""
    return pose(4, -7, 2, about=(6, -8, 25))
