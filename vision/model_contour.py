"""The vision model as sampled contours: which of its circles a view shows, and where they fall in the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import View
from vision.circle_pose import plane_axes
from vision.vision_model import VisionModel

Array = NDArray[np.float64]

SAMPLE_SPACING_PX = 3.0
GRAZING_COSINE = 0.12  # a circle seen at more than 83 degrees from its normal is not expected to show an edge


@dataclass(frozen=True, eq=False)
class Projection:
    """The samples of a contour in one view.

    Attributes:
        index: (N,) which samples of the contour these are; only those on circles that face the camera.
        pixels: (N, 2) where they project.
        normals: (N, 2) unit normals of the projected circle.
    """

    index: NDArray[np.intp]
    pixels: Array
    normals: Array


@dataclass(frozen=True, eq=False)
class ModelContour:
    """Points along the circles of a vision model, dense enough for the image scale at hand.

    Attributes:
        points: (S, 3) in the part's frame, metres.
        tangents: (S, 3) unit tangents.
        normals: (S, 3) normals of the circles.
        circle: (S,) number of the circle a sample belongs to.
        circle_salient: (C,) whether the circle is a salient feature.
        circle_symmetric: (C,) whether the circle looks the same under every rotation about z.
        circle_weight: (C,) how much it counts: the edge support that it had when it was taught.
    """

    points: Array
    tangents: Array
    normals: Array
    circle: NDArray[np.intp]
    circle_salient: NDArray[np.bool_]
    circle_symmetric: NDArray[np.bool_]
    circle_weight: Array

    @classmethod
    def of(cls, model: VisionModel, scale_px_per_m: float) -> ModelContour:
        """Sample the circles of a model at an image scale (focal length over distance)."""
        parts: list[tuple[Array, Array, Array]] = []
        salient, symmetric, weight = [], [], []
        for feature in model.features:
            on_axis = float(np.hypot(*feature.circle.centre[:2])) < 1e-3 * model.diameter_m
            for circle in feature.circles():
                circumference_px = 2 * np.pi * circle.radius_m * scale_px_per_m
                n = int(np.clip(circumference_px / SAMPLE_SPACING_PX, 12, 160))
                u, v = plane_axes(circle.normal)
                t = np.linspace(0, 2 * np.pi, n, endpoint=False)[:, None]
                points = circle.centre + circle.radius_m * (np.cos(t) * u + np.sin(t) * v)
                tangents = -np.sin(t) * u + np.cos(t) * v
                parts.append((points, tangents, np.broadcast_to(circle.normal, (n, 3))))
                salient.append(feature.role == "salient")
                symmetric.append(on_axis)
                weight.append(feature.support)
        points, tangents, normals = (np.vstack([p[k] for p in parts]) for k in range(3))
        number = np.repeat(np.arange(len(parts)), [len(p[0]) for p in parts])
        return cls(points, tangents, normals, number, np.array(salient), np.array(symmetric), np.array(weight))

    def project(self, T_world_part: Array, view: View) -> Projection:
        """Project the samples of the circles that face the camera.

        Args:
            T_world_part: 4x4 pose.
            view: with a distortion-free lens.
        """
        T = np.linalg.inv(view.T_world_camera.as_matrix()) @ T_world_part
        R = T[:3, :3]
        points = self.points @ R.T + T[:3, 3]
        facing = -np.einsum("ij,ij->i", self.normals @ R.T, points) / np.linalg.norm(points, axis=1)
        index = np.flatnonzero((facing > GRAZING_COSINE) & (points[:, 2] > 1e-3))
        x, y, z = points[index].T
        tx, ty, tz = (self.tangents[index] @ R.T).T
        camera = view.camera
        pixels = np.column_stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
        along = np.column_stack([camera.fx * (tx - x / z * tz), camera.fy * (ty - y / z * tz)])
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        return Projection(index, pixels, np.column_stack([along[:, 1], -along[:, 0]]))
