"""The region-growing method (Section 5.1): boundaries of the regions that are left after pruning become ellipses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.boundary_consensus import agree, best_stretch, explained, part_covered, rms_distance, undo_shrinking
from vision.ellipse import Array, Ellipse
from vision.ellipse_fit import fit_ellipse
from vision.errors import InputError
from vision.features import EllipseFeature, RegionAttributes
from vision.region_attributes import AttributeConstraints
from vision.region_boundary import refine_boundaries
from vision.segmentation import Region, RegionGrowing, Segmentation, check_gray, gradient, segment

__all__ = [
    "AttributeConstraints",
    "BoundaryFit",
    "Region",
    "RegionGrowing",
    "Segmentation",
    "circumference_covered",
    "region_ellipses",
    "segment",
]

_SPACING = 3
"""Contour points per boundary point: closer together than the blur reaches, their errors would not be independent."""

_CAMERA_AND_SOBEL_VARIANCE = 0.9
"""Blur besides that of edge detection, in px²: Sobel's kernel 0.46, the pixel's area 0.08, a lens of 0.6 px."""

_CORRELATION = 0.2
"""Of the errors of neighbouring boundary points, 3 px apart: noise blurred by 1.2 px, exp(-3² / (4 * 1.2²))."""

_MIN_POINTS = 7
"""Fewer points are not taken for an ellipse."""


@dataclass(frozen=True)
class BoundaryFit:
    """When a boundary passes for an ellipse.

    Attributes:
        tolerance_px: largest distance of a boundary point to its ellipse.
        sigma_px: standard deviation of a boundary point at its best.
        max_rms_px: largest root mean square distance of the points that support the ellipse.
        min_support: smallest part of the circumference that boundary points cover.
        min_semi_axis_px: smallest semi-minor axis.
        min_axis_ratio: smallest ratio of the axes.
        max_per_boundary: ellipses looked for on one boundary (two touching parts may share one region).
    """

    tolerance_px: float = 1.2
    sigma_px: float = 0.05
    max_rms_px: float = 0.5
    min_support: float = 0.3
    min_semi_axis_px: float = 4.0
    min_axis_ratio: float = 0.2
    max_per_boundary: int = 2

    def __post_init__(self) -> None:
        if not all(length > 0 for length in (self.tolerance_px, self.sigma_px, self.max_rms_px)):
            raise InputError("boundary fit", got=self, expected="tolerance, sigma and rms > 0 px")


def region_ellipses(
    segmentation: Segmentation,
    gray: NDArray[np.uint8],
    constraints: AttributeConstraints | None = None,
    fit: BoundaryFit | None = None,
    growing: RegionGrowing | None = None,
) -> list[EllipseFeature]:
    """Ellipses on the outer and inner boundaries of the regions that the constraints leave.

    The two rims of an annulus bound one region: its outer and its inner boundary each give an ellipse. Parts of
    a boundary that belong to an occluder do not agree with the rest, and are left out of the fit; what remains
    has to cover enough of the circumference.

    Args:
        segmentation: of the image.
        gray: (H, W) uint8, the image that was segmented.
        constraints: on the attributes of regions; None prunes nothing.
        fit: when a boundary passes for an ellipse; None for the defaults.
        growing: the settings that the segmentation was made with; None for the defaults.

    Returns:
        Features with ``process="region"`` and the attributes of their region, best score first; one per ellipse,
        also where regions on its two sides both found it.

    Raises:
        InputError: when the image is not the one that was segmented, by its shape or type.
    """
    fit, growing = fit or BoundaryFit(), growing or RegionGrowing()
    gray = check_gray(gray)
    if gray.shape != segmentation.labels.shape:
        raise InputError(
            "image", got=gray.shape, expected=f"the shape that was segmented, {segmentation.labels.shape}"
        )
    regions = (constraints or AttributeConstraints()).prune(segmentation.regions)
    outer = [(region.contour, False, region.attributes) for region in regions]
    inner = [(hole, True, region.attributes) for region in regions for hole in region.holes]
    shortest = np.pi * fit.min_semi_axis_px
    # Outer boundaries first: an ellipse that two regions share gets the attributes of the region inside it.
    candidates = [c for c in outer + inner if len(c[0]) > shortest]
    slopes = gradient(gray, growing.blur_px)
    boundaries = refine_boundaries([c[:2] for c in candidates], slopes, 32 * growing.edge_low, _SPACING)
    blur_variance = growing.blur_px**2 + _CAMERA_AND_SOBEL_VARIANCE
    features: list[EllipseFeature] = []
    conics, counts = np.empty((0, 3, 3)), np.empty(0, int)
    for boundary, (_, _, attributes) in zip(boundaries, candidates, strict=True):
        fresh = ~explained(conics, counts, boundary.points, boundary.outwards, fit.tolerance_px)
        for feature, conic in _boundary_ellipses(
            boundary.points[fresh], boundary.outwards[fresh], attributes, fit, blur_variance
        ):
            features.append(feature)
            conics, counts = np.concatenate([conics, conic[None]]), np.append(counts, len(feature.points))
    return _distinct(sorted(features, key=lambda f: -f.score))


def _boundary_ellipses(
    points: Array, outwards: Array, attributes: RegionAttributes, fit: BoundaryFit, blur_variance: float
) -> Iterator[tuple[EllipseFeature, Array]]:
    """The ellipses on the points of one boundary and their conics, the one that most points agree with first."""
    for _ in range(fit.max_per_boundary):
        if len(points) < _MIN_POINTS:
            return
        rough, on_ellipse = best_stretch(points, outwards, fit.tolerance_px)
        if not _is_promising(rough, on_ellipse, fit):
            return
        unshrunk = undo_shrinking(rough, points, blur_variance)
        settled = _settle(rough, on_ellipse, unshrunk, outwards, fit)
        if settled is None:
            return
        ellipse, conic, on_ellipse = settled
        feature = _judge(ellipse, conic, unshrunk[on_ellipse], attributes, fit)
        if feature is not None:
            yield feature, conic
        points, outwards = points[~on_ellipse], outwards[~on_ellipse]


def _is_promising(rough: Array, on_ellipse: NDArray[np.bool_], fit: BoundaryFit) -> bool:
    """Whether an ellipse (5,) and the points that agree with it are nearly good enough to pass."""
    semi_major, semi_minor = rough[2:4]
    # Steps along a pixel contour are at most a diagonal long, so that few points cannot cover much.
    reach = np.count_nonzero(on_ellipse) * _SPACING * np.sqrt(2)
    long_enough = reach >= fit.min_support * np.pi * (semi_major + semi_minor)
    return bool(long_enough and semi_minor >= 0.8 * max(fit.min_semi_axis_px, fit.min_axis_ratio * semi_major, 1e-9))


def _settle(
    rough: Array, on_ellipse: NDArray[np.bool_], points: Array, outwards: Array, fit: BoundaryFit
) -> tuple[Ellipse, Array, NDArray[np.bool_]] | None:
    """Fit the ellipse to the points that agree with it, and again, until these are the same points.

    Args:
        rough: (5,) geometric parameters.
        on_ellipse: (N,) the points that agree with it.
        points: (N, 2) of the boundary.
        outwards: (N, 2) its normals.
        fit: when a boundary passes for an ellipse.

    Returns:
        The ellipse, its conic and the points on it, or None where they determine none.
    """
    ellipse = Ellipse.from_geometric(*rough)
    for _ in range(3):
        fitted = fit_ellipse(points[on_ellipse], fit.sigma_px, initial=ellipse)
        if fitted is None or fitted.semi_axes[1] < 0.05 * fitted.semi_axes[0]:
            return None
        ellipse, conic = fitted, fitted.conic
        before, on_ellipse = on_ellipse, agree(conic, points, outwards, fit.tolerance_px)
        if np.count_nonzero(before != on_ellipse) <= 0.02 * len(points):
            break
    return ellipse, conic, on_ellipse


def _judge(
    ellipse: Ellipse, conic: Array, points: Array, attributes: RegionAttributes, fit: BoundaryFit
) -> EllipseFeature | None:
    """The ellipse as a feature, or None where the fit is poor."""
    semi_major, semi_minor = ellipse.semi_axes
    if semi_minor < max(fit.min_semi_axis_px, fit.min_axis_ratio * semi_major) or len(points) < _MIN_POINTS:
        return None
    rms = rms_distance(conic, points)
    support = circumference_covered(ellipse, points)
    if rms > fit.max_rms_px or support < fit.min_support:
        return None
    if ellipse.covariance is not None:
        # Sums over a chain of correlated errors vary more than sums over independent ones, by this factor.
        ellipse = Ellipse(ellipse.p, ellipse.covariance * (1 + _CORRELATION) / (1 - _CORRELATION))
    score = support / (1 + (rms / fit.max_rms_px) ** 2)
    return EllipseFeature(ellipse, "region", points, support, score, attributes)


def circumference_covered(ellipse: Ellipse, points: Array, cell_px: float = 6.0) -> float:
    """The part of the circumference, cut into cells of about the given length, that has points (N, 2) near it."""
    geometric = ellipse.geometric
    cells = int(np.clip(np.pi * (geometric[2] + geometric[3]) / cell_px, 12, 360))
    return float(part_covered(geometric, points, cells))


def _distinct(features: list[EllipseFeature]) -> list[EllipseFeature]:
    """The features without those that repeat a better one, up to what a pixel grid can tell apart."""
    if not features:
        return []
    shape = np.array([f.ellipse.geometric[:4] for f in features])
    near = 1.0 + 0.02 * shape[:, 3]
    same = np.abs(shape[:, None] - shape[None]).max(axis=2) < near
    kept: list[int] = []
    for i in range(len(features)):
        if not same[i, kept].any():
            kept.append(i)
    return [features[i] for i in kept]
