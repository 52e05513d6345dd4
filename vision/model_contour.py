"""The vision model as sampled contours: which of its features a view shows, and where they fall in the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.camera import View
from vision.circle_pose import Circle
from vision.evidence import FULL_ALIGNMENT, LOOSEST_ALIGNMENT
from vision.model_curves import along_circle, along_pattern
from vision.vision_model import VisionModel, turns_about_axis

Array = NDArray[np.float64]

INPLANE_STRIDE = 2  # of the samples, where the rotation about z is looked for all the way round
RIM_SLACK = 0.03  # taught radii are not exact, rims are rounded
COVER_MARGIN = 0.1  # of the part's radius, behind the surface of another part
COVER_BLOCK_PX = 4  # what parts hide is known by blocks of pixels
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
    """Points along the circles and patterns of a vision model, dense enough for the image scale at hand.

    Each copy of a feature counts as a circle of its own, also a pattern's, whose points lie on no circle.

    Attributes:
        points: (S, 3) in the part's frame, metres.
        tangents: (S, 3) unit tangents.
        normals: (S, 3) unit vectors to the side from which the circles are seen.
        circle: (S,) number of the circle a sample belongs to, ascending.
        circle_salient: (C,) whether the circle is a salient feature.
        circle_drawn: (C,) whether it is a pattern.
        circle_symmetric: (C,) whether the circle looks the same under every rotation about z.
        circle_weight: (C,) how much it counts: the edge support that it had when it was taught.
        circle_copies: (C,) number of copies of its feature for the first of them, 0 for the others.
        rims: (C, B, 2) radius and height of the salient circles through or past which a circle is seen; NaN fills up.
    """

    points: Array
    tangents: Array
    normals: Array
    circle: NDArray[np.intp]
    circle_salient: NDArray[np.bool_]
    circle_drawn: NDArray[np.bool_]
    circle_symmetric: NDArray[np.bool_]
    circle_weight: Array
    circle_copies: NDArray[np.intp]
    rims: Array

    @cached_property
    def reach_m(self) -> float:
        """Largest distance of a sample from the part's axis; 0 without samples."""
        return float(np.hypot(self.points[:, 0], self.points[:, 1]).max(initial=0.0))

    @cached_property
    def circle_feature(self) -> NDArray[np.intp]:
        """(C,) number of the feature that a circle is a copy of: the model's circles first, then its patterns."""
        return np.asarray(np.cumsum(self.circle_copies > 0) - 1, np.intp)

    def asymmetric(self) -> ModelContour:
        """The circles alone that tell the rotation about z; the numbering of the circles stays."""
        return self._asymmetric

    def first_copies(self) -> ModelContour:
        """Of the circles that tell the rotation about z the first of each feature, thinned; the numbering stays."""
        return self._first_copies

    def salient(self) -> ModelContour:
        """Every second sample of the salient circles; the numbering of the circles stays."""
        return self._salient

    def sparse(self) -> ModelContour:
        """Every fourth sample of the salient circles; the numbering of the circles stays."""
        return self._sparse

    @cached_property
    def _sparse(self) -> ModelContour:
        return self._only(self.circle_salient)._samples(slice(None, None, 4))

    @cached_property
    def _asymmetric(self) -> ModelContour:
        return self._only(~self.circle_symmetric)

    @cached_property
    def _first_copies(self) -> ModelContour:
        return self._only(~self.circle_symmetric & (self.circle_copies > 0))._samples(
            slice(None, None, INPLANE_STRIDE)
        )

    @cached_property
    def _salient(self) -> ModelContour:
        return self._only(self.circle_salient)._samples(slice(None, None, 2))

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
        """Sample the features of a model at an image scale (focal length over distance)."""
        curves = [along_circle(feature, model, scale_px_per_m) for feature in model.features]
        curves += [along_pattern(pattern, model) for pattern in model.patterns]
        turns = [(curve, turn) for curve in curves for turn in turns_about_axis(curve.copies)]
        points, tangents, normals = (
            np.vstack([getattr(curve, name) @ turn.T for curve, turn in turns])
            for name in ("points", "tangents", "normals")
        )
        first = [number == 0 for curve in curves for number in range(curve.copies)]
        of_all = [curve for curve, _ in turns]
        return cls(
            points,
            tangents,
            normals,
            np.repeat(np.arange(len(turns)), [len(curve.points) for curve in of_all]),
            np.array([curve.salient for curve in of_all]),
            np.array([curve.drawn for curve in of_all]),
            np.array([curve.symmetric for curve in of_all]),
            np.array([curve.weight for curve in of_all]),
            np.array([curve.copies * is_first for curve, is_first in zip(of_all, first, strict=True)]),
            _rims_before([(curve.normals[0, 2], curve.points[:, 2].mean()) for curve in of_all], model),
        )

    def project(self, T_world_part: Array, view: View) -> Projection:
        """Project the samples of the circles that face the camera.

        Args:
            T_world_part: 4x4 pose.
            view: with a distortion-free lens.
        """
        T = np.linalg.inv(view.T_world_camera.as_matrix()) @ T_world_part
        camera = view.camera
        intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        samples = (self.points, self.tangents, self.normals, self.circle, self.rims)
        return Projection(*_project(np.ascontiguousarray(T), intrinsics, samples))


def _rims_before(sides: Sequence[tuple[float, float]], model: VisionModel) -> Array:
    """For curves of a side, +1 or -1, and height: the salient circles of that side nearer to the eye, (C, B, 2)."""
    rims = [f.circle for f in model.salient]
    slack = 0.01 * model.diameter_m
    before = [
        [(rim.radius_m, rim.centre[2]) for rim in rims if _is_before(rim, np.sign(side), height, slack)]
        for side, height in sides
    ]
    out = np.full((len(sides), max(map(len, before), default=0), 2), np.nan)
    for row, found in zip(out, before, strict=True):
        row[: len(found)] = np.reshape(found, (-1, 2))
    return out


def _is_before(rim: Circle, side: float, height: float, slack: float) -> bool:
    return bool(side == np.sign(rim.normal[2]) and side * (rim.centre[2] - height) > slack)


@njit(cache=True, inline="always")
def passes_rims(x, y, z, rims, eye):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Whether a point of the part is seen from the eye past the rims before it, all in the part's frame.

    The surface of one body joins the point and the rim. A line of sight that starts on one side of the rim's radius
    and crosses the rim's plane on the other side has gone through that surface: the floor of a cup hides behind the
    wall, a flange behind the hat.
    """
    own = x * x + y * y
    for k in range(len(rims)):
        square = rims[k, 0] * rims[k, 0]
        if np.isnan(square):
            break
        share = (rims[k, 1] - z) / (eye[2] - z)
        across, along = x + share * (eye[0] - x), y + share * (eye[1] - y)
        crossing = across * across + along * along
        if own < square:
            if crossing > (1 + RIM_SLACK) ** 2 * square:
                return False
        elif crossing < (1 - RIM_SLACK) ** 2 * square:
            return False
    return True


@njit(cache=True)
def _project(T, intrinsics, samples):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Index, pixels and unit normals of the samples in sight."""
    points, tangents, normals, circle, rims = samples
    fx, fy, cx, cy = intrinsics
    eye = eye_of(T)
    index = np.empty(len(points), np.intp)
    pixels, across = np.empty((len(points), 2)), np.empty((len(points), 2))
    count = 0
    for i in range(len(points)):
        x, y, z = moved(T, points[i])
        nx, ny, nz = rotated(T, normals[i])
        if z <= 1e-3 or -(nx * x + ny * y + nz * z) <= GRAZING_COSINE * np.sqrt(x * x + y * y + z * z):
            continue
        if not passes_rims(points[i, 0], points[i, 1], points[i, 2], rims[circle[i]], eye):
            continue
        tx, ty, tz = rotated(T, tangents[i])
        du, dv = fx * (tx - x / z * tz), fy * (ty - y / z * tz)
        length = max(np.sqrt(du * du + dv * dv), 1e-12)
        index[count] = i
        pixels[count, 0], pixels[count, 1] = fx * x / z + cx, fy * y / z + cy
        across[count, 0], across[count, 1] = dv / length, -du / length
        count += 1
    return index[:count], pixels[:count], across[:count]


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
        samples: points, tangents, normals (S, 3), circle numbers (S,) and rims (C, B, 2).
        edges: distance (V, H, W), direction (V, H, W, 2), claimed (V, H, W), and the depth beyond which parts
            already found hide what is there, by blocks of pixels.
        reach_px: tolerance.
        total: (N, V, C) added to.
        count: (N, V, C, 2) added to: the samples that nothing known hides, and all that face the camera.
    """
    points, tangents, normals, circle, rims = samples
    distance, direction, claimed, cover = edges
    height, width = claimed.shape[1:]
    margin = COVER_MARGIN * np.abs(points).max()
    for pose in range(len(poses)):
        for view in range(len(claimed)):
            T = cameras[0][view] @ poses[pose]
            fx, fy, cx, cy = cameras[1][view]
            eye = eye_of(T)
            current, facing_away = -1, False
            n = np.zeros(3)
            for i in range(len(points)):
                c = circle[i]
                if c != current:
                    current = c
                    n[0], n[1], n[2] = rotated(T, normals[i])
                    # From behind the plane of a circle none of it is seen.
                    x, y, z = moved(T, points[i])
                    facing_away = n[0] * x + n[1] * y + n[2] * z >= 0
                if facing_away:
                    continue
                x, y, z = moved(T, points[i])
                if z < 1e-3 or -(n[0] * x + n[1] * y + n[2] * z) <= GRAZING_COSINE * np.sqrt(x * x + y * y + z * z):
                    continue
                u, v = int(np.rint(fx * x / z + cx)), int(np.rint(fy * y / z + cy))
                if u < 2 or v < 2 or u > width - 3 or v > height - 3:
                    continue
                if not passes_rims(points[i, 0], points[i, 1], points[i, 2], rims[c], eye):
                    continue
                count[pose, view, c, 1] += 1.0
                if z > cover[view, v // COVER_BLOCK_PX, u // COVER_BLOCK_PX] + margin:
                    continue
                count[pose, view, c, 0] += 1.0
                near = (reach_px - distance[view, v, u]) / (reach_px - 1.0)
                if near <= 0.0 or claimed[view, v, u]:
                    continue
                tx, ty, tz = rotated(T, tangents[i])
                du, dv = fx * (tx - x / z * tz), fy * (ty - y / z * tz)
                length = np.sqrt(du * du + dv * dv)
                aligned = abs(direction[view, v, u, 0] * dv - direction[view, v, u, 1] * du) / max(length, 1e-12)
                share = (aligned - LOOSEST_ALIGNMENT) / (FULL_ALIGNMENT - LOOSEST_ALIGNMENT)
                total[pose, view, c] += min(near, 1.0) * min(max(share, 0.0), 1.0)


@njit(cache=True, inline="always")
def moved(T, p):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The point T p."""
    x, y, z = rotated(T, p)
    return x + T[0, 3], y + T[1, 3], z + T[2, 3]


@njit(cache=True, inline="always")
def rotated(T, p):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The direction T p."""
    return (
        T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2],
        T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2],
        T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2],
    )


@njit(cache=True)
def eye_of(T_camera_part):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """The camera's centre (3,) in the part's frame."""
    T, out = T_camera_part, np.empty(3)
    for j in range(3):
        out[j] = -(T[0, j] * T[0, 3] + T[1, j] * T[1, 3] + T[2, j] * T[2, 3])
    return out
