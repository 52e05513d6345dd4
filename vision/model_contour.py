"""The vision model as sampled contours: which of its circles a view shows, and where they fall in the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.camera import View
from vision.circle_pose import plane_axes
from vision.vision_model import VisionModel

Array = NDArray[np.float64]

SAMPLE_SPACING_PX = 3.0
COVER_MARGIN = 0.1  # of the part's radius, behind the surface of another part
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

    @cached_property
    def reach_m(self) -> float:
        """Largest distance of a sample from the part's axis; 0 without samples."""
        return float(np.hypot(self.points[:, 0], self.points[:, 1]).max(initial=0.0))

    def asymmetric(self) -> ModelContour:
        """The circles alone that tell the rotation about z; the numbering of the circles stays."""
        return self._asymmetric

    def salient(self) -> ModelContour:
        """The salient circles alone; the numbering of the circles stays."""
        return self._salient

    def sparse(self) -> ModelContour:
        """Every third sample of the salient circles; the numbering of the circles stays."""
        return self._sparse

    @cached_property
    def _sparse(self) -> ModelContour:
        return self._salient._samples(slice(None, None, 3))

    @cached_property
    def _asymmetric(self) -> ModelContour:
        return self._only(~self.circle_symmetric)

    @cached_property
    def _salient(self) -> ModelContour:
        return self._only(self.circle_salient)

    def _only(self, circles: NDArray[np.bool_]) -> ModelContour:
        return self._samples(circles[self.circle])

    def _samples(self, chosen: NDArray[np.bool_] | slice) -> ModelContour:
        return replace(
            self,
            points=np.ascontiguousarray(self.points[chosen]),
            tangents=np.ascontiguousarray(self.tangents[chosen]),
            normals=np.ascontiguousarray(self.normals[chosen]),
            circle=np.ascontiguousarray(self.circle[chosen]),
        )

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


@njit(cache=True)
def tally_support(  # type: ignore[no-untyped-def]
    poses, cameras, samples, edges, reach_px, total, count
):  # pragma: no cover - compiled
    """Add the edge support of each circle's samples to ``total`` and their number to ``count``.

    The same as :meth:`ModelContour.project` followed by :meth:`vision.evidence.EdgeField.support`, in one pass: the
    innermost loop of matching.

    Args:
        poses: (N, 4, 4) T_world_part.
        cameras: T_camera_world (V, 4, 4) and fx, fy, cx, cy (V, 4).
        samples: points, tangents, normals (S, 3) and circle numbers (S,).
        edges: distance (V, H, W), direction (V, H, W, 2), claimed (V, H, W), and the depth (V, H, W) beyond which
            parts already found hide what is there.
        reach_px: tolerance.
        total: (N, V, C) added to.
        count: (N, V, C, 2) added to: the samples that nothing known hides, and all that face the camera.
    """
    points, tangents, normals, circle = samples
    distance, direction, claimed, cover = edges
    height, width = claimed.shape[1:]
    margin = COVER_MARGIN * np.abs(points).max()
    loosest, tightest = np.cos(np.radians(35.0)), np.cos(np.radians(15.0))
    for pose in range(len(poses)):
        for view in range(len(claimed)):
            T = cameras[0][view] @ poses[pose]
            R, t = T[:3, :3], T[:3, 3]
            fx, fy, cx, cy = cameras[1][view]
            for i in range(len(points)):
                p, n = points[i], normals[i]
                x = R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0]
                y = R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1]
                z = R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2]
                nx = R[0, 0] * n[0] + R[0, 1] * n[1] + R[0, 2] * n[2]
                ny = R[1, 0] * n[0] + R[1, 1] * n[1] + R[1, 2] * n[2]
                nz = R[2, 0] * n[0] + R[2, 1] * n[1] + R[2, 2] * n[2]
                if z < 1e-3 or -(nx * x + ny * y + nz * z) <= GRAZING_COSINE * np.sqrt(x * x + y * y + z * z):
                    continue
                u, v = int(np.rint(fx * x / z + cx)), int(np.rint(fy * y / z + cy))
                if u < 2 or v < 2 or u > width - 3 or v > height - 3:
                    continue
                count[pose, view, circle[i], 1] += 1.0
                if z > cover[view, v, u] + margin:
                    continue
                count[pose, view, circle[i], 0] += 1.0
                near = (reach_px - distance[view, v, u]) / (reach_px - 1.0)
                if near <= 0.0 or claimed[view, v, u]:
                    continue
                q = tangents[i]
                tx = R[0, 0] * q[0] + R[0, 1] * q[1] + R[0, 2] * q[2]
                ty = R[1, 0] * q[0] + R[1, 1] * q[1] + R[1, 2] * q[2]
                tz = R[2, 0] * q[0] + R[2, 1] * q[1] + R[2, 2] * q[2]
                du, dv = fx * (tx - x / z * tz), fy * (ty - y / z * tz)
                length = np.sqrt(du * du + dv * dv)
                aligned = abs(direction[view, v, u, 0] * dv - direction[view, v, u, 1] * du) / max(length, 1e-12)
                share = (aligned - loosest) / (tightest - loosest)
                total[pose, view, circle[i]] += min(near, 1.0) * min(max(share, 0.0), 1.0)
