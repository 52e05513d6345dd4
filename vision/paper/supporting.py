"""The second phase (Section 6): supporting features around a prediction verify it and tell its turn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vision.features import EllipseFeature
from vision.frozen import frozen_arrays
from vision.geometry.camera import Camera, View
from vision.model.vision_model import CircleFeature, VisionModel

Array = NDArray[np.float64]

RADIAL_SHARE = 0.15  # of a feature's distance from the axis: how far off it may be seen
SIZE_FACTOR = 1.6  # by which its size may differ
KERNEL_RAD = np.radians(6.0)
STEPS = 720


LEAST_RADIUS_PX = 12.0
LARGEST_SCALE = 4.0
WINDOW = 0.7  # half the side of the window over the part's diameter
MOST_OF_PICTURE = 0.4  # a window that is more of the picture is the picture: others can share it
SAME_SCALE = 0.2  # of the logarithm of the depth
NEAR = 0.15  # of the part's diameter: a prediction so near another one is looked for in the same windows


def window(view: View, T_world_part: Array, diameter_m: float, radii_m: Sequence[float]) -> View | None:
    """The part of a view around a prediction, magnified so that its smallest feature is large enough to extract.

    Neither extractor takes what is narrower than seven pixels for an ellipse.

    Returns:
        A view whose camera belongs to the magnified picture; None where the prediction lies outside the picture.
    """
    centre = T_world_part[:3, 3]
    depth = float((view.T_world_camera.inv().apply(centre))[2])
    if depth <= 0:
        return None
    camera, px_per_m = view.camera, view.camera.fx / depth
    scale = float(np.clip(np.ceil(LEAST_RADIUS_PX / (px_per_m * min(radii_m))), 1, LARGEST_SCALE))
    half = WINDOW * diameter_m * px_per_m
    x, y = view.project(centre)[0]
    left, top = max(0, int(x - half)), max(0, int(y - half))
    right, bottom = min(camera.width_px, int(x + half) + 1), min(camera.height_px, int(y + half) + 1)
    if right - left < 8 or bottom - top < 8:
        return None
    if (right - left) * (bottom - top) > MOST_OF_PICTURE * camera.width_px * camera.height_px:
        left, top, right, bottom = 0, 0, camera.width_px, camera.height_px
    picture = cv2.resize(
        np.ascontiguousarray(view.gray[top:bottom, left:right]),
        None,
        fx=scale,
        fy=scale,
        interpolation=cv2.INTER_CUBIC,
    )
    # A pixel's coordinate is its centre: of the magnified pixels, the first ones lie before that.
    offset = (scale - 1) / 2
    magnified = Camera(
        picture.shape[1],
        picture.shape[0],
        camera.fx * scale,
        camera.fy * scale,
        (camera.cx - left) * scale + offset,
        (camera.cy - top) * scale + offset,
    )
    return View(picture, magnified, view.T_world_camera, view.name)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Sighting:
    """A small ellipse where a supporting feature can be.

    Attributes:
        view: number of the view.
        feature: number of the supporting feature.
        pixel: (2,) centre of the ellipse.
        turn_rad: by how much the prediction has to turn about its axis to explain it, up to the feature's copies.
    """

    view: int
    feature: int
    pixel: Array
    turn_rad: float


def sightings(
    T_world_part: Array,
    found: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    supporting: Sequence[CircleFeature],
) -> list[Sighting]:
    """The ellipses that can be supporting features of a part at this pose (4, 4), up to its turn about the axis."""
    seen = []
    for v, (view, ellipses) in enumerate(zip(views, found, strict=True)):
        if not ellipses:
            continue
        T = np.linalg.inv(T_world_part) @ view.T_world_camera.as_matrix()
        eye = T[:3, 3]
        centres = np.array([e.ellipse.centre for e in ellipses])
        sizes = np.array([e.ellipse.semi_axes[0] for e in ellipses])
        rays = view.camera.rays(centres) @ T[:3, :3].T
        for k, feature in enumerate(supporting):
            centre, normal, radius = feature.circle.centre, feature.circle.normal, feature.circle.radius_m
            if (eye - centre) @ normal <= 0:
                continue
            along = (centre[2] - eye[2]) / np.where(np.abs(rays[:, 2]) > 1e-9, rays[:, 2], np.inf)
            points = eye + along[:, None] * rays
            offset = np.hypot(*centre[:2])
            expected_px = view.camera.fx * radius / np.maximum(along * np.linalg.norm(rays, axis=1), 1e-6)
            near = np.abs(np.hypot(points[:, 0], points[:, 1]) - offset) < RADIAL_SHARE * offset
            alike = np.abs(np.log(sizes / expected_px)) < np.log(SIZE_FACTOR)
            for i in np.flatnonzero(near & alike):
                turn = np.arctan2(points[i, 1], points[i, 0]) - np.arctan2(centre[1], centre[0])
                seen.append(Sighting(v, k, centres[i], float(turn)))
    return seen


def best_turn(
    seen: Sequence[Sighting], supporting: Sequence[CircleFeature], fold: int | None
) -> tuple[float, list[Sighting]]:
    """The turn about the axis that most sightings agree on, in radians, and those that do.

    Args:
        seen: of one prediction.
        supporting: the features.
        fold: the part's symmetry; None where every turn looks the same.
    """
    if not seen:
        return 0.0, []
    turns = np.array([s.turn_rad for s in seen])
    periods = np.array([2 * np.pi / supporting[s.feature].copies for s in seen])
    angles = np.linspace(0, 2 * np.pi / (fold or 1), STEPS, endpoint=False)

    def off(angle: Array) -> Array:
        difference = turns - angle[:, None]
        return np.asarray(difference - periods * np.round(difference / periods))

    # A sighting of one of many copies is likely to agree by chance: it counts by how much it narrows the turn down.
    votes = np.exp(-0.5 * (off(angles) / KERNEL_RAD) ** 2) @ np.minimum(periods, 2 * np.pi)
    best = angles[[int(np.argmax(votes))]]
    residual = off(best)[0]
    agree = np.abs(residual) < 2 * KERNEL_RAD
    turn = float(best[0] + residual[agree].mean()) if agree.any() else float(best[0])
    return turn, [s for s, yes in zip(seen, agree, strict=True) if yes]


class SecondLook:
    """Looks for the supporting features around predictions; those that lie near each other share their windows."""

    def __init__(
        self, views: Sequence[View], model: VisionModel, extract: Callable[[View], Sequence[EllipseFeature]]
    ) -> None:
        """Prepare.

        Args:
            views: with distortion-free lenses.
            model: with the supporting features.
            extract: runs the extractor that was taught for them.
        """
        self._views, self._model, self._extract = views, model, extract
        self._looked: list[list[tuple[Array, View, Sequence[EllipseFeature]]]] = [[] for _ in views]

    def sightings(self, T_world_part: Array) -> list[Sighting]:
        """The ellipses that can be supporting features of a part at this pose (4, 4), up to its turn."""
        if not self._model.supporting:
            return []
        numbers, windows, found = [], [], []
        for v in range(len(self._views)):
            looked = self._window(v, T_world_part)
            if looked is not None:
                numbers.append(v)
                windows.append(looked[0])
                found.append(looked[1])
        seen = sightings(T_world_part, found, windows, self._model.supporting)
        return [replace(s, view=numbers[s.view]) for s in seen]

    def _window(self, v: int, T_world_part: Array) -> tuple[View, Sequence[EllipseFeature]] | None:
        view, diameter_m = self._views[v], self._model.diameter_m
        centre = view.T_world_camera.inv().apply(T_world_part[:3, 3])
        if centre[2] <= 0:
            return None
        place = np.append(centre[:2] / centre[2], np.log(centre[2]))
        for known, window_view, found in self._looked[v]:
            near = np.linalg.norm(known - place) * centre[2] < NEAR * diameter_m
            whole = window_view.camera.width_px >= view.camera.width_px
            if near or (whole and abs(known[2] - place[2]) < SAME_SCALE):
                return window_view, found
        made = window(view, T_world_part, diameter_m, [c.circle.radius_m for c in self._model.supporting])
        if made is None:
            return None
        self._looked[v].append((place, made, self._extract(made)))
        return self._looked[v][-1][1:]


def turned(T_world_part: Array, turn_rad: float) -> Array:
    """The pose (4, 4) turned about the part's own axis."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.0, 0.0, turn_rad]).as_matrix()
    return np.asarray(T_world_part @ turn)
