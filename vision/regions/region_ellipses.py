"""The region-growing method (Section 5.1): boundaries of the regions that are left after pruning become ellipses."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from vision.edges.edge_map import GRADIENT_UNIT, image_gradients
from vision.features import EllipseFeature
from vision.geometry.blur import CAMERA_VARIANCE, SOBEL_VARIANCE
from vision.geometry.ellipse import Ellipse
from vision.kernels import njit
from vision.regions.attributes import AttributeConstraints
from vision.regions.boundaries import Outline, refine_boundaries
from vision.regions.boundary_ellipses import BoundaryLimits, find_ellipses
from vision.regions.segmentation import Region, RegionGrowingParameters, Segmentation, segment
from vision.settings import NOT_NEGATIVE, POSITIVE, SHARE, check, count

__all__ = [
    "AttributeConstraints",
    "BoundaryFitParameters",
    "Region",
    "RegionGrowingParameters",
    "Segmentation",
    "region_ellipses",
    "segment",
]

_SPACING = 3
"""Contour points per boundary point: closer together than the blur reaches, their errors would not be independent."""

_CORRELATION = 0.31
"""Of the errors of neighbouring boundary points, 3 px apart: noise blurred by 1.2 px and by Sobel's kernel (variance
1/2 along the edge), exp(-3² / (4 * (1.2² + 0.5)))."""


@dataclass(frozen=True)
class BoundaryFitParameters:
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
    sigma_px: float = 0.03
    max_rms_px: float = 0.5
    min_support: float = 0.3
    min_semi_axis_px: float = 4.0
    min_axis_ratio: float = 0.2
    max_per_boundary: int = 2

    def __post_init__(self) -> None:
        check(self, tolerance_px=POSITIVE, sigma_px=POSITIVE, max_rms_px=POSITIVE, min_semi_axis_px=NOT_NEGATIVE)
        check(self, min_support=SHARE, min_axis_ratio=SHARE, max_per_boundary=count(1))


def region_ellipses(
    segmentation: Segmentation,
    constraints: AttributeConstraints | None = None,
    fit: BoundaryFitParameters | None = None,
) -> list[EllipseFeature]:
    """Ellipses on the outer and inner boundaries of the regions that the constraints leave.

    The two rims of an annulus bound one region: its outer and its inner boundary each give an ellipse. Parts of
    a boundary that belong to an occluder do not agree with the rest, and are left out of the fit; what remains
    has to cover enough of the circumference.

    Args:
        segmentation: of the image, which it holds with the settings it was made with.
        constraints: on the attributes of regions; None prunes nothing.
        fit: when a boundary passes for an ellipse; None for the defaults.

    Returns:
        Features with ``extractor="region"`` and the attributes of their region, best score first; one per ellipse,
        also where regions on its two sides both found it.
    """
    fit, growing = fit or BoundaryFitParameters(), segmentation.parameters
    constraints = constraints or AttributeConstraints()
    regions = segmentation.prune(constraints)
    outer = [Outline(region.contour, False, region.attributes) for region in regions]
    inner = [Outline(hole, True, region.attributes) for region in regions for hole in region.holes]
    # A contour has up to a third fewer points than pixels of length: its diagonal steps are longer than one.
    least_px, _ = constraints.perimeter_px or (0.0, np.inf)
    shortest = max(np.pi * fit.min_semi_axis_px, least_px / np.sqrt(2))
    # Outer boundaries first: an ellipse that two regions share gets the attributes of the region inside it.
    outlines = [outline for outline in outer + inner if len(outline.contour) > shortest]
    if not outlines:
        return []
    dx, dy = image_gradients(segmentation.gray, growing.blur_px)
    boundaries = refine_boundaries(outlines, dx, dy, GRADIENT_UNIT * growing.edge_low, _SPACING)
    blur_variance = growing.blur_px**2 + SOBEL_VARIANCE + CAMERA_VARIANCE
    limits = BoundaryLimits(**asdict(fit), blur_variance=blur_variance, spacing_px=float(_SPACING))
    found = find_ellipses(boundaries, limits)
    score = found.support / (1 + (found.rms_px / fit.max_rms_px) ** 2)
    best_first = np.argsort(-score, kind="stable")
    # Sums over a chain of correlated errors vary more than sums over independent ones, by this factor.
    covariance = found.covariance * ((1 + _CORRELATION) / (1 - _CORRELATION))
    return [
        EllipseFeature(
            Ellipse(found.p[i], covariance[i]),
            "region",
            found.points[found.ends[i] : found.ends[i + 1]],
            float(found.support[i]),
            float(score[i]),
            outlines[found.boundary[i]].attributes,
        )
        for i in best_first[_is_distinct(found.geometric[best_first])]
    ]


@njit(cache=True)
def _is_distinct(geometric):
    """Which ellipses (N, 5) do not repeat one that is kept before them, up to what a pixel grid can tell apart."""
    kept = np.zeros(len(geometric), np.bool_)
    for i in range(len(geometric)):
        near = 1.0 + 0.02 * geometric[i, 3]
        kept[i] = True
        for k in range(i):
            if kept[k] and np.abs(geometric[i, :4] - geometric[k, :4]).max() < near:
                kept[i] = False
                break
    return kept
