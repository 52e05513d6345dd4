"""The visible contour of a vision model: its circles and patterns sampled as curves, projected into views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays, read_only
from vision.geometry.camera import View
from vision.geometry.circle import Circle, plane_axes
from vision.kernels import njit
from vision.model.grasp import turns_about_z
from vision.model.projection import ContourSamples, project_samples
from vision.model.vision_model import CircleFeature, Pattern, VisionModel

Array = NDArray[np.float64]

SAMPLE_SPACING_PX = 3.0
PATTERN_SAMPLES = 24  # of one copy


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Curve:
    """The first copy of a feature, sampled: points, tangents and normals (S, 3)."""

    points: Array
    tangents: Array
    normals: Array
    copies: int
    weight: float
    salient: bool
    drawn: bool
    symmetric: bool


def along_circle(feature: CircleFeature, model: VisionModel, scale_px_per_m: float) -> Curve:
    """A circular feature, sampled for an image scale (focal length over distance)."""
    circle = feature.circle
    circumference_px = 2 * np.pi * circle.radius_m * scale_px_per_m
    n = int(np.clip(circumference_px / SAMPLE_SPACING_PX, 12, 160))
    u, v = plane_axes(circle.normal)
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)[:, None]
    points = circle.centre + circle.radius_m * (np.cos(t) * u + np.sin(t) * v)
    tangents = -np.sin(t) * u + np.cos(t) * v
    normals = np.broadcast_to(circle.normal, (n, 3))
    symmetric = float(np.hypot(*circle.centre[:2])) < 1e-3 * model.diameter_m
    return Curve(
        points, tangents, normals, feature.copies, feature.support, feature.role == "salient", False, symmetric
    )


def along_pattern(pattern: Pattern, model: VisionModel) -> Curve:
    """One sector of a pattern, which is the same in all; the whole pattern, should a sector be empty."""
    fold = model.symmetry_fold or 1
    sector = np.flatnonzero(np.arctan2(pattern.points[:, 1], pattern.points[:, 0]) % (2 * np.pi) < 2 * np.pi / fold)
    if not len(sector):
        sector, fold = np.arange(len(pattern.points)), 1
    chosen = sector[:: -(-len(sector) // PATTERN_SAMPLES)]
    normals = np.broadcast_to(pattern.normal, (len(chosen), 3))
    return Curve(pattern.points[chosen], pattern.directions[chosen], normals, fold, 1.0, False, True, False)


INPLANE_STRIDE = 2  # of the samples, where the rotation about z is looked for all the way round
COVER_MARGIN = 0.1  # of the part's radius, behind the surface of another part


@dataclass(frozen=True, eq=False)
@frozen_arrays
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
@frozen_arrays
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
        return read_only(np.asarray(np.cumsum(self.circle_copies > 0) - 1, np.intp))

    @cached_property
    def samples(self) -> ContourSamples:
        """The samples for the compiled loops."""
        points, tangents, normals = (np.ascontiguousarray(a.T) for a in (self.points, self.tangents, self.normals))
        rims = np.ascontiguousarray(np.moveaxis(self.rims[self.circle], 0, 2))
        margin_m = COVER_MARGIN * float(np.abs(points).max(initial=0.0))
        return read_only(ContourSamples(points, tangents, normals, self.circle, rims, margin_m))

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
            points=self.points[chosen],
            tangents=self.tangents[chosen],
            normals=self.normals[chosen],
            circle=np.ascontiguousarray(self.circle[chosen]),
        )

    @classmethod
    def of(cls, model: VisionModel, scale_px_per_m: float) -> ModelContour:
        """Sample the features of a model at an image scale (focal length over distance)."""
        curves = [along_circle(feature, model, scale_px_per_m) for feature in model.features]
        curves += [along_pattern(pattern, model) for pattern in model.patterns]
        turns = [(curve, turn) for curve in curves for turn in turns_about_z(curve.copies).as_matrix()]
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
        return Projection(*_project(np.ascontiguousarray(T), intrinsics, self.samples))


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


@njit(cache=True, error_model="numpy")
def _project(T, intrinsics, samples):
    """Index, pixels and unit normals of the samples in sight."""
    size = len(samples.circle)
    image, shown = np.empty((5, size)), np.empty(size, np.bool_)
    project_samples(T, intrinsics, samples, image, shown)
    index = np.flatnonzero(shown)
    return index, image[:2, index].T.copy(), image[3:, index].T.copy()
