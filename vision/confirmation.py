"""Second phase of matching: the edges along all features of a posed model confirm or refute it (Section 6).

Salient circles alone leave open which face of the part is seen and how it is turned about its axis; the supporting
features (bolt holes, slots) decide, by whether edges run where they must be (Fig. 9 d).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vision.camera import View
from vision.evidence import EdgeField
from vision.model_contour import ModelContour, tally_support
from vision.pose import Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH_PX = 3.0
INPLANE_STEP_PX = 1.5
CLAIM_SUPPORT = 0.3


@dataclass(frozen=True, eq=False)
class Evidence:
    """The edge support of a posed model.

    Attributes:
        score: weighted mean support over all visible circles, 0 to 1.
        salient: the same over the salient circles only.
        supporting: the same over the supporting circles only; NaN where none is visible.
        views: number of views whose support is at least half of the best view's.
    """

    score: float
    salient: float
    supporting: float
    views: int


class SceneEdges:
    """The edge fields of all views, and which edges have been claimed by parts already found."""

    def __init__(self, views: Sequence[View], fields: Sequence[EdgeField]) -> None:
        """Nothing is claimed at first.

        Args:
            views: with distortion-free lenses.
            fields: their edge fields.
        """
        self.views, self.fields = views, fields
        self._claimed: list[Mask] = [np.zeros(f.distance.shape, bool) for f in fields]
        self._T_camera_world = [np.linalg.inv(v.T_world_camera.as_matrix()) for v in views]

    def evidence(self, T_world_part: Array, contour: ModelContour, reach_px: float = REACH_PX) -> Evidence:
        """Support of a pose by edges within ``reach_px`` that no other part has claimed."""
        per_view = [self._support(v, T_world_part, contour, reach_px) for v in range(len(self.views))]
        total, count = (np.stack([tally[k] for tally in per_view]) for k in (0, 1))
        # A small hole says as much per pixel as a rim, but a rim is longer: square roots balance the two.
        weight = contour.circle_weight * np.sqrt(count.sum(axis=0))
        mean = total.sum(axis=0) / np.maximum(count.sum(axis=0), 1)
        visible = count.sum(axis=0) > 0
        salient = visible & contour.circle_salient
        supporting = visible & ~contour.circle_salient
        of_view = total.sum(axis=1) / np.maximum(count.sum(axis=1), 1)
        return Evidence(
            _mean(mean[visible], weight[visible], 0.0),
            _mean(mean[salient], weight[salient], 0.0),
            _mean(mean[supporting], weight[supporting], np.nan),
            int(np.count_nonzero(of_view > 0.5 * max(of_view.max(), 0.1))),
        )

    def inplane_support(self, T_world_part: Array, contour: ModelContour, angles: Array) -> Array:
        """Mean support (A,) of the circles that tell the rotation about z, at each of the angles (A,)."""
        part = contour.asymmetric()
        out = np.zeros(len(angles))
        for a, angle in enumerate(angles):
            T = turned(T_world_part, angle)
            tallies = [self._support(v, T, part) for v in range(len(self.views))]
            total, count = (sum(tally[k] for tally in tallies) for k in (0, 1))
            out[a] = part.circle_weight @ total / max(float(part.circle_weight @ count), 1.0)
        return out

    def find_inplane(self, T_world_part: Array, contour: ModelContour, fold: int) -> tuple[Array, bool]:
        """Turn a pose about its axis to where the supporting features have edges.

        Args:
            T_world_part: 4x4, any rotation about z.
            contour: of the model.
            fold: number of rotations that look the same.

        Returns:
            The turned pose, and whether the best angle stands out from the rest.
        """
        lever = contour.asymmetric().reach_m
        if lever == 0:
            return T_world_part, False
        distance = min(np.linalg.norm(v.T_world_camera.translation - T_world_part[:3, 3]) for v in self.views)
        step = INPLANE_STEP_PX / (lever * self.views[0].camera.fx / distance)
        angles = np.arange(0, 2 * np.pi / fold, step)
        support = self.inplane_support(T_world_part, contour, angles)
        best = int(support.argmax())
        fine = angles[best] + np.linspace(-step, step, 9)
        fine_support = self.inplane_support(T_world_part, contour, fine)
        angle = fine[int(fine_support.argmax())]
        spread = float(np.median(np.abs(support - np.median(support)))) * 1.4826
        stands_out = bool(fine_support.max() - np.median(support) > max(4 * spread, 0.08))
        return turned(T_world_part, angle), stands_out

    def observe(
        self, T_world_part: Array, contour: ModelContour, reach_px: float, sigma_px: float = 0.3
    ) -> Observations:
        """Sub-pixel edges along the visible circles of a posed model, claimed ones left out."""
        blocks: list[tuple[NDArray[np.intp], Array, Array, Array, NDArray[np.intp]]] = []
        for v, (view, field) in enumerate(zip(self.views, self.fields, strict=True)):
            projection = contour.project(T_world_part, view)
            free = field.inside(projection.pixels) & ~self._is_claimed(v, projection.pixels)
            pixels, normals = projection.pixels[free], projection.normals[free]
            offsets, _ = field.measure(pixels, normals, reach_px)
            found = np.isfinite(offsets)
            seen = pixels[found] + offsets[found, None] * normals[found]
            index = projection.index[free][found]
            of_view = np.full(len(seen), v, np.intp)
            blocks.append((of_view, contour.points[index], seen, normals[found], contour.circle[index]))
        view_index, points, pixels, normals, circle = (np.concatenate([b[k] for b in blocks]) for k in range(5))
        return Observations(view_index, points, pixels, normals, np.full(len(view_index), sigma_px), circle)

    def claim(self, T_world_part: Array, contour: ModelContour, width_px: int = 2) -> None:
        """Mark the edges that a part explains as its own."""
        for v, view in enumerate(self.views):
            projection = contour.project(T_world_part, view)
            support = self.fields[v].support(projection.pixels, projection.normals, REACH_PX)
            support[self._is_claimed(v, projection.pixels)] = 0
            height, width = self.fields[v].distance.shape
            for x, y in np.round(projection.pixels[support > CLAIM_SUPPORT]).astype(int):
                rows = slice(max(y - width_px, 0), min(y + width_px + 1, height))
                self._claimed[v][rows, max(x - width_px, 0) : min(x + width_px + 1, width)] = True

    def _support(
        self, v: int, T_world_part: Array, contour: ModelContour, reach_px: float = REACH_PX
    ) -> tuple[Array, Array]:
        """Sum of the support and number of the samples, (C,) each, of the circles that face the camera of view v."""
        field, camera = self.fields[v], self.views[v].camera
        total, count = np.zeros(len(contour.circle_weight)), np.zeros(len(contour.circle_weight))
        tally_support(
            np.ascontiguousarray(self._T_camera_world[v] @ T_world_part),
            (camera.fx, camera.fy, camera.cx, camera.cy),
            (contour.points, contour.tangents, contour.normals, contour.circle),
            (field.distance, field.direction, self._claimed[v]),
            reach_px,
            total,
            count,
        )
        return total, count

    def _is_claimed(self, v: int, pixels: Array) -> Mask:
        claimed = self._claimed[v]
        height, width = claimed.shape
        columns = np.clip(np.round(pixels[:, 0]), 0, width - 1).astype(np.intp)
        rows = np.clip(np.round(pixels[:, 1]), 0, height - 1).astype(np.intp)
        return np.asarray(claimed[rows, columns])


def turned(T_world_part: Array, angle: float) -> Array:
    """The pose (4x4) after a rotation of the part about its own z axis."""
    out = T_world_part.copy()
    out[:3, :3] = T_world_part[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return out


def _mean(values: Array, weights: Array, empty: float) -> float:
    return float(values @ weights / weights.sum()) if len(values) and weights.sum() > 0 else empty
