"""The features of a vision model as sampled curves: along a circle, or along the edges of a pattern."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.circle_pose import plane_axes
from vision.vision_model import CircleFeature, Pattern, VisionModel

Array = NDArray[np.float64]

SAMPLE_SPACING_PX = 3.0
PATTERN_SAMPLES = 24  # of one copy


@dataclass(frozen=True, eq=False)
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
