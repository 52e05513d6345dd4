"""What both extractors and the matching do with one image, stage by stage, as pictures (Figs. 5 to 9, 11 and 12)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vision.drawing import stage_panels as stages
from vision.drawing.panel import Canvas, Panel
from vision.edges.edge_map import as_gray
from vision.errors import InputError
from vision.extraction import Extraction
from vision.geometry.camera import View
from vision.geometry.ellipse import Ellipse
from vision.grouping.detector import detect, halved
from vision.grouping.edge_grouping import Grouping
from vision.model.contour import ModelContour
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate
from vision.regions.region_ellipses import region_ellipses
from vision.regions.segmentation import segment

__all__ = ["MODEL_FREE_PANELS", "PANELS", "Panel", "explain", "explain_view"]

FINE_BELOW_PX = 1000
"""Images with shorter sides than this are drawn at twice their size."""

MODEL_FREE_PANELS = ("1_edges", "2_regions", "3_region_ellipses", "4_fragments", "5_groups", "6_filter")
"""Names of the panels of an image about which nothing is known."""

PANELS = (
    "1_edges",
    "2_regions",
    "2b_pruned_regions",
    "3_region_ellipses",
    "4_fragments",
    "5_groups",
    "6_filter",
    "7_supporting_features",
    "8_poses",
)
"""Names of the panels of a view in which taught parts were looked for with both extractors."""


def explain(image: NDArray[np.generic]) -> tuple[Panel, ...]:
    """Run region growing and edge grouping on an image and draw what each stage found.

    The groups are those of :func:`vision.grouping.detector.detect_ellipses`.

    Args:
        image: uint8, (H, W) grey or (H, W, 3) RGB. One with more than 1600 px along a side is halved first.

    Returns:
        The panels of ``MODEL_FREE_PANELS``.

    Raises:
        InputError: when it is not an image, see :func:`vision.edges.edge_map.as_gray`, or has no pixels to draw on.
    """
    whole = as_gray(image)
    if whole.size == 0:
        raise InputError("image", got=f"shape {whole.shape}", expected="at least 1 x 1 pixels")
    gray, factor = halved(whole)
    canvas = Canvas(gray, _zoom(gray))
    segmentation = segment(gray)
    detection = detect(whole)
    grouping, coarse = detection.grouping, [Ellipse(f.ellipse.p / factor) for f in detection.coarse]
    return (
        _edges_of_groups(canvas, grouping),
        stages.regions(canvas, segmentation),
        stages.region_ellipses(canvas, segmentation, region_ellipses(segmentation), segmentation.regions),
        stages.fragments(canvas, grouping),
        stages.groups(canvas, grouping, coarse),
        stages.kalman_filter(canvas, grouping.features),
    )


def explain_view(
    view: View,
    extraction: Extraction,
    estimates: Sequence[PoseEstimate],
    models: Sequence[VisionModel],
    zoom: int | None = None,
) -> tuple[Panel, ...]:
    """Draw how taught parts were found in a view.

    Args:
        view: with a distortion-free lens.
        extraction: what the localizer's extractors found in it,
            see :meth:`vision.localizer.EllipseLocalizer.extraction`.
        estimates: the poses that the localizer stands by, from this view and others.
        models: of the parts.
        zoom: whole number by which the panels are larger than the view; None for 2 where it is small.

    Returns:
        The panels of ``PANELS``; without those of an extractor that was not asked.
    """
    canvas = Canvas(view.gray, zoom or _zoom(view.gray))
    contours = {model.part: _contour(model, estimates, view) for model in models}
    panels = [_edges(canvas, extraction)]
    segmentation, grouping = extraction.segmentation, extraction.grouping
    if segmentation is not None:
        found = extraction.of_extractor("region")
        left = segmentation.regions if extraction.constraints is None else segmentation.prune(extraction.constraints)
        panels += [
            stages.regions(canvas, segmentation),
            stages.pruned_regions(canvas, segmentation, extraction.constraints),
            stages.region_ellipses(canvas, segmentation, found, left),
        ]
    if grouping is not None:
        shown = replace(grouping, features=extraction.of_extractor("group"))
        panels += [
            stages.fragments(canvas, shown),
            stages.groups(canvas, shown),
            stages.kalman_filter(canvas, shown.features),
        ]
    panels += [draw(canvas, view, estimates, contours) for draw in (stages.supporting_features, stages.poses)]
    return tuple(panels)


def _zoom(gray: NDArray[np.uint8]) -> int:
    return 2 if max(gray.shape) < FINE_BELOW_PX else 1


def _edges(canvas: Canvas, extraction: Extraction) -> Panel:
    """Those of edge grouping; the linked ones of region growing where that works alone."""
    if extraction.grouping is not None:
        return _edges_of_groups(canvas, extraction.grouping)
    segmentation = extraction.segmentation
    linked = np.zeros(canvas.gray.shape, np.bool_) if segmentation is None else segmentation.edges
    return stages.edges(canvas, linked, f"{np.count_nonzero(linked)} pixels")


def _edges_of_groups(canvas: Canvas, grouping: Grouping) -> Panel:
    return stages.edges(canvas, grouping.edges.index >= 0, f"{len(grouping.edges)} chains")


def _contour(model: VisionModel, estimates: Sequence[PoseEstimate], view: View) -> ModelContour:
    """The model sampled for the distance at which the first of its instances lies."""
    eye = view.T_world_camera.translation
    distances = [np.linalg.norm(e.T_world_part.translation - eye) for e in estimates if e.part == model.part]
    return ModelContour.of(model, view.camera.fx / float(distances[0]) if distances else 1.0)
