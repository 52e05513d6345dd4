"""Region growing as printed (Section 5.1): regions pruned by all the taught attributes, boundaries fitted whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.features import EllipseFeature
from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Ellipse
from vision.model.vision_model import CircleFeature
from vision.regions.attributes import AttributeConstraints
from vision.regions.region_ellipses import BoundaryFitParameters, region_ellipses
from vision.regions.segmentation import Region, RegionGrowingParameters, segment
from vision.settings import POSITIVE, check

Array = NDArray[np.float64]
FEWEST_POINTS = 12


@dataclass(frozen=True)
class PruningParameters:
    """How closely a region must have the attributes that were taught, and its boundary be an ellipse.

    The taught ranges are those of an unhidden part that lies flat. What is tilted or partly hidden shows less area
    and is less circular.

    Attributes:
        growing: of the segmentation.
        smaller: factor on the least area, perimeter and circularity.
        larger: factor on the largest area, perimeter and shape complexity.
        grey: factor by which the grey levels may differ either way.
        fit: when a boundary passes for an ellipse.
        whole_boundaries: fit whole outer boundaries as printed, instead of what most of a boundary agrees on.
    """

    growing: RegionGrowingParameters = field(default_factory=RegionGrowingParameters)
    fit: BoundaryFitParameters = field(default_factory=BoundaryFitParameters)
    whole_boundaries: bool = False
    smaller: float = 0.03
    larger: float = 10.0
    grey: float = 5.0

    def __post_init__(self) -> None:
        check(self, smaller=POSITIVE, larger=POSITIVE, grey=POSITIVE)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class NamedEllipse:
    """An ellipse, and which circles of the model it can be by its attributes.

    Attributes:
        feature: the ellipse.
        circles: (K,) for each circle asked for, whether it can be that one.
    """

    feature: EllipseFeature
    circles: NDArray[np.bool_]


def grow_ellipses(
    gray: NDArray[np.uint8],
    circles: Sequence[CircleFeature],
    px_per_m: tuple[float, float],
    parameters: PruningParameters | None = None,
) -> list[NamedEllipse]:
    """Ellipses on the boundaries of the regions that are left after pruning.

    Args:
        gray: (H, W) uint8.
        circles: the features to look for, with their taught attributes.
        px_per_m: smallest and largest scale of a circle in the workspace.
        parameters: thresholds.
    """
    parameters = parameters or PruningParameters()
    constraints = [attribute_constraints(c, px_per_m, parameters) for c in circles]
    segmentation = segment(gray, parameters.growing)
    if parameters.whole_boundaries:
        fits = [_fit(region, parameters.fit.max_rms_px) for region in segmentation.regions]
        features = [fit for fit in fits if fit is not None]
    else:
        features = region_ellipses(segmentation, None, parameters.fit)
    found = []
    for feature in features:
        attributes = feature.attributes
        allowed = np.array([attributes is not None and c.allow(attributes) for c in constraints])
        if allowed.any():
            found.append(NamedEllipse(feature, allowed))
    return found


def attribute_constraints(
    circle: CircleFeature, px_per_m: tuple[float, float], parameters: PruningParameters
) -> AttributeConstraints:
    """The bounds on the attributes of a region that shows a feature; those that were not taught are free.

    The distance from which it was taught is not in the model: the taught perimeter over the circle's tells the scale.
    """
    taught = dict(circle.attributes)
    if "perimeter_px" not in taught:
        return AttributeConstraints()
    seen_px = (taught["perimeter_px"].low + taught["perimeter_px"].high) / 2
    least, most = (2 * np.pi * circle.circle.radius_m * scale / seen_px for scale in px_per_m)
    smaller, larger, grey = parameters.smaller, parameters.larger, parameters.grey
    factors = {
        "area_px": (smaller * least**2, larger * most**2),
        "perimeter_px": (smaller * least, larger * most),
        "circularity": (smaller, 1 / smaller),
        "shape_complexity": (smaller, larger),
        "grey_mean": (1 / grey, grey),
        "grey_deviation": (1 / grey**2, grey**2),
    }
    return AttributeConstraints(
        **{
            name: (low * taught[name].low, high * taught[name].high)
            for name, (low, high) in factors.items()
            if name in taught
        }
    )


def _fit(region: Region, max_rms_px: float) -> EllipseFeature | None:
    """Least squares over the whole outer boundary."""
    z = region.contour.astype(np.float64)
    if len(z) < FEWEST_POINTS:
        return None
    (x, y), (width, height), angle_deg = cv2.fitEllipseDirect(region.contour)
    if not (np.isfinite([x, y, width, height, angle_deg]).all() and min(width, height) > 0):
        return None
    turned = np.radians(angle_deg) + (np.pi / 2 if height > width else 0.0)
    major, minor = max(width, height) / 2, min(width, height) / 2
    ellipse = Ellipse.from_geometric(x, y, major, minor, turned)
    rms = float(np.sqrt((ellipse.distance(z) ** 2).mean()))
    if rms > max_rms_px:
        return None
    # Half a pixel more: from the centres of the boundary's pixels to their outer sides.
    ellipse = Ellipse.from_geometric(x, y, major + 0.5, minor + 0.5, turned)
    return EllipseFeature(ellipse, "region", z, 1.0, 1.0 / (1.0 + rms), region.attributes)
