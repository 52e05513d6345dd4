"""How much the grey level changes across an outline."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.geometry.ellipse import Ellipse

Array = NDArray[np.float64]

VISIBLE_CONTRAST, FAINT_CONTRAST = 8.0, 2.5  # grey levels
SAMPLES = 256  # round an outline
_SIDE_PX = 1.7  # from the outline to where the grey level is taken on either side


def steps_across(canvas: Array, ellipse: Ellipse) -> Array:
    """Grey level within less that without, at ``SAMPLES`` points of an outline; 0 where that is not in the image.

    Args:
        canvas: (H, W) grey levels before blur and noise.
        ellipse: the outline, sampled as ``Ellipse.sample`` does it.
    """
    outline = ellipse.sample(SAMPLES)
    outward = np.column_stack([outline, np.ones(SAMPLES)]) @ ellipse.conic[:, :2]
    outward /= np.hypot(*outward.T)[:, None]
    smooth = cv2.GaussianBlur(canvas, (0, 0), 0.6)
    limit = np.array(canvas.shape[::-1]) - 1
    sides = [np.round(outline + step * outward).astype(int) for step in (-_SIDE_PX, _SIDE_PX)]
    inside_image = np.all([(side >= 0).all(axis=1) & (side <= limit).all(axis=1) for side in sides], axis=0)
    greys = [smooth[tuple(np.clip(side, 0, limit).T[::-1])] for side in sides]
    return np.asarray(np.where(inside_image, greys[0] - greys[1], 0.0))
