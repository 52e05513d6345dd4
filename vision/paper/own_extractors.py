"""This project's two extractors in the place of the paper's: not the paper's, but an idea that was added to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.extraction import run_extractors
from vision.model.vision_model import CircleFeature
from vision.paper.parameters import PaperParameters
from vision.paper.region_growing import NamedEllipse


def both_extractors(
    gray: NDArray[np.uint8],
    circles: Sequence[CircleFeature],
    px_per_m: tuple[float, float],
    parameters: PaperParameters,
) -> list[NamedEllipse]:
    """The ellipses of both extractors, each of which can be every circle of its size.

    Args:
        gray: (H, W) uint8.
        circles: the features to look for.
        px_per_m: smallest and largest scale of a circle in the workspace.
        parameters: with the slack of the sizes.
    """
    radii_m = np.array([c.circle.radius_m for c in circles])
    least = (1 - parameters.size_slack) * px_per_m[0] * radii_m
    most = (1 + parameters.size_slack) * px_per_m[1] * radii_m
    found = []
    for feature in run_extractors(gray, ("region", "group")).features:
        major = feature.ellipse.semi_axes[0]
        fits = (least <= major) & (major <= most)
        if fits.any():
            found.append(NamedEllipse(feature, fits))
    return found
