"""What the two extractors hand to matching: ellipses with the edge points that speak for them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Ellipse

Extractor = Literal["region", "group"]


@dataclass(frozen=True)
class RegionAttributes:
    """The intrinsic attributes of the paper's Sections 4 and 5.1.

    Attributes:
        area_px: number of pixels.
        perimeter_px: length of the outer boundary in pixels.
        circularity: 4 pi area / perimeter², 1 for a disc.
        shape_complexity: perimeter² / area of the outer boundary over that of the fitted ellipse, 1 for an ellipse.
        grey_mean: mean grey level, 0 to 255.
        grey_deviation: standard deviation of the grey level.
    """

    area_px: float
    perimeter_px: float
    circularity: float
    shape_complexity: float
    grey_mean: float
    grey_deviation: float


@dataclass(frozen=True, eq=False)
@frozen_arrays
class EllipseFeature:
    """An ellipse that an extractor found in one view.

    Attributes:
        ellipse: the fitted ellipse, with covariance.
        extractor: which extractor found it.
        points: (N, 2) sub-pixel edge points that support it, pixels; read-only.
        support: the part of the circumference that edge points cover, 0 to 1.
        score: goodness, higher is better, comparable within one extractor.
        attributes: of the region inside, where the extractor measures them.
    """

    ellipse: Ellipse
    extractor: Extractor
    points: NDArray[np.float64]
    support: float
    score: float
    attributes: RegionAttributes | None = field(default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", np.array(self.points, dtype=float))
