"""What both extractors find in a picture, in the form in which the page draws it."""

from __future__ import annotations

import base64
import hashlib
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.drawing.strokes import region_colours
from vision.extraction import ExtractionThresholds
from vision.features import EllipseFeature
from vision.grouping.edge_grouping import Grouping, group_edges
from vision.regions.region_ellipses import region_ellipses
from vision.regions.segmentation import Segmentation, segment

Image = NDArray[np.uint8]

EDGE_RGB = (120, 255, 190)


def overlay_tag(thresholds: ExtractionThresholds) -> str:
    """Names the thresholds that an overlay was made with, for addresses."""
    return hashlib.sha256(repr(thresholds).encode()).hexdigest()[:12]


def make_overlay(gray: Image, thresholds: ExtractionThresholds) -> dict[str, Any]:
    """Run region growing and edge grouping on a picture (Figs. 5 and 6), ready for JSON.

    Args:
        gray: (H, W) uint8 of a distortion-free lens.
        thresholds: of the extractors.

    Returns:
        ``candidates`` (ellipses with their extractor), ``fragments`` (polylines), ``endpoints``, ``groups`` (numbers
        of fragments), and two pictures as data addresses: ``regions_png`` and ``edges_png``.
    """
    segmentation = segment(gray, thresholds.growing)
    regions = region_ellipses(segmentation, None, thresholds.boundary_fit)
    grouping = group_edges(gray, thresholds.grouping)
    fragments = grouping.fragments
    return {
        "candidates": [_candidate(feature) for feature in [*regions, *grouping.features]],
        "fragments": [_thinned(fragment.points) for fragment in fragments],
        "endpoints": [point for fragment in fragments for point in fragment.endpoints.round(1).tolist()],
        "groups": [list(group) for group in grouping.groups],
        "regions_png": _data_url(_paint_regions(segmentation)),
        "edges_png": _data_url(_paint_edges(grouping)),
    }


def no_overlay() -> dict[str, Any]:
    """An overlay with nothing in it."""
    nothing = _data_url(np.zeros((1, 1, 4), np.uint8))
    return {
        "candidates": [],
        "fragments": [],
        "endpoints": [],
        "groups": [],
        "regions_png": nothing,
        "edges_png": nothing,
    }


def _candidate(feature: EllipseFeature) -> dict[str, Any]:
    return {
        "extractor": feature.extractor,
        "ellipse": feature.ellipse.geometric.round(3).tolist(),
        "support": round(feature.support, 3),
    }


def _thinned(points: NDArray[np.float64]) -> list[list[float]]:
    """Every other point of a polyline, and both ends."""
    kept = points[::2] if len(points) % 2 else np.vstack([points[::2], points[-1:]])
    return kept.round(1).tolist()


def _paint_regions(segmentation: Segmentation) -> Image:
    """(H, W, 4) RGBA: every region in a colour of its own, boundaries transparent."""
    table = np.zeros((len(segmentation.regions) + 1, 4), np.uint8)
    if segmentation.regions:
        labels = [region.label for region in segmentation.regions]
        table[labels, :3] = region_colours(segmentation.regions)
        table[labels, 3] = 255
    return table[np.maximum(segmentation.labels, 0)]


def _paint_edges(grouping: Grouping) -> Image:
    seen = grouping.edges.index >= 0
    image = np.zeros((*seen.shape, 4), np.uint8)
    image[seen] = (*EDGE_RGB, 255)
    return image


def _data_url(rgba: Image) -> str:
    encoded = cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA))[1]
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
