"""The answer drawn over the picture: taught circles and patterns at the poses that were found (Figs. 11 c, 12 b)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vision.drawing.strokes import Image, Strokes, model_strokes, paint, plain_strokes
from vision.errors import InputError
from vision.geometry.camera import View
from vision.model.contour import ModelContour
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate

FINE_BELOW_PX = 1000
"""Pictures narrower than this are drawn at twice their size."""


def superimpose(view: View, estimates: Sequence[PoseEstimate], models: Sequence[VisionModel]) -> Image:
    """Draw the models of the parts that were found over a view.

    Args:
        view: one of those that the poses come from, or any other of the same scene.
        estimates: the poses.
        models: those of their parts.

    Returns:
        RGB, without the distortion of the lens; twice as wide and high where the view is narrower than 1000 px.

    Raises:
        InputError: when a part has no model.
    """
    flat = view.undistorted()
    taught = {model.part: model for model in models}
    strokes: Strokes = plain_strokes((), (255, 255, 255))
    for estimate in estimates:
        if estimate.part not in taught:
            raise InputError("models", got=", ".join(taught) or "none", expected=f"one of {estimate.part}")
        T_world_part = estimate.T_world_part.as_matrix()
        distance_m = np.linalg.norm(T_world_part[:3, 3] - flat.T_world_camera.translation)
        contour = ModelContour.of(taught[estimate.part], flat.camera.fx / float(distance_m))
        strokes += model_strokes(contour, T_world_part, flat)
    return paint(flat.image, strokes, zoom=2 if flat.camera.width_px < FINE_BELOW_PX else 1)
