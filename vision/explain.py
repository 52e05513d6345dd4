"""What both extractors do with one image, stage by stage, as pictures (Figs. 5 to 8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.drawing import (
    Image,
    Strokes,
    ellipse_strokes,
    enlarge,
    fragment_strokes,
    group_strokes,
    halved,
    paint,
    paint_regions,
    plain_strokes,
)
from vision.edges import as_gray
from vision.ellipse import Ellipse
from vision.ellipse_filter import moment_estimate
from vision.filter_history import filter_history
from vision.grouping import Grouping, group_edges
from vision.regions import region_ellipses
from vision.segmentation import segment

FINE_BELOW_PX = 1000
"""Images with shorter sides than this are drawn at twice their size."""

LARGEST_PX = 1600
"""Images with a longer side are halved before anything else, as :func:`vision.grouping.detect_ellipses` does."""

FILTER_POINTS = (4, 8, 16, 32, 64)
"""After how many points the state of the filter is drawn."""

WHITE = (255, 255, 255)
_FADE = 0.45


@dataclass(frozen=True, eq=False)
class Panel:
    """One picture of a stage.

    Attributes:
        name: for a file, for example ``4_fragments``.
        title: for people.
        image: RGB; read-only.
    """

    name: str
    title: str
    image: Image

    def __post_init__(self) -> None:
        view = self.image.view()
        view.flags.writeable = False
        object.__setattr__(self, "image", view)

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the image stays read-only."""
        return (Panel, (self.name, self.title, self.image))


def explain(image: NDArray[np.generic]) -> tuple[Panel, ...]:
    """Run region growing and edge grouping on an image and draw what each stage found.

    Args:
        image: uint8, (H, W) grey or (H, W, 3) RGB.

    Returns:
        Edges, regions, region ellipses, fragments, groups, the filter on the best group, in this order.

    Raises:
        InputError: when it is not an image, see :func:`vision.edges.as_gray`.
    """
    gray, _ = halved(as_gray(image), LARGEST_PX)
    zoom = 2 if max(gray.shape) < FINE_BELOW_PX else 1
    segmentation, grouping = segment(gray), group_edges(gray)
    features = region_ellipses(segmentation, gray)
    bounded = {feature.attributes for feature in features}
    kept = [region for region in segmentation.regions if region.attributes in bounded]
    # Lines show better on a faded picture.
    faded = np.asarray(gray * _FADE, np.uint8)
    regions = paint_regions(gray, segmentation, segmentation.regions, zoom=zoom)
    pruned = paint(paint_regions(faded, segmentation, kept), ellipse_strokes(features), zoom=zoom, thickness_px=zoom)
    fragments = paint(faded, fragment_strokes(grouping), zoom=zoom, thickness_px=zoom)
    groups = paint(faded, group_strokes(grouping), zoom=zoom, thickness_px=2 * zoom)
    outlines = plain_strokes(ellipse_strokes(grouping.features).lines, WHITE)
    groups = _paint_over(groups, outlines, zoom)
    return (
        Panel("1_edges", f"Edges: {len(grouping.edges.closed)} chains", _edges(grouping, zoom)),
        Panel("2_regions", f"Region growing: {len(segmentation.regions)} regions", regions),
        Panel("3_region_ellipses", f"Regions with an elliptic boundary: {len(features)} ellipses", pruned),
        Panel("4_fragments", f"Edge grouping: {len(grouping.table)} fragments", fragments),
        Panel("5_groups", f"Groups of fragments: {len(grouping.features)} ellipses", groups),
        Panel(
            "6_filter", "Kalman filter: the best ellipse after more and more points", _filter(faded, grouping, zoom)
        ),
    )


def _filter(faded: Image, grouping: Grouping, zoom: int) -> Image:
    """The estimate of the Kalman filter, from orange before the first point to white after all."""
    if not grouping.features:
        return paint(faded, plain_strokes((), WHITE), zoom=zoom)
    best = max(grouping.features, key=lambda f: len(f.points) * f.score)
    points = best.points[np.random.default_rng(0).permutation(len(best.points))]
    start = moment_estimate(points)
    states = list(filter_history(points, start))
    shown = [states[min(n, len(states)) - 1] for n in FILTER_POINTS if n <= len(states)] + states[-1:]
    rings = [ellipse.sample(120) for ellipse in (Ellipse(start), *(state.ellipse for state in shown))]
    lines = tuple(np.vstack([ring, ring[:1]]) for ring in rings)
    shades = np.linspace(0, 1, len(lines))
    colours = np.array([(255, 140 + 115 * s, 255 * s) for s in shades], np.uint8)
    return paint(faded, Strokes(lines, colours), zoom=zoom, thickness_px=zoom)


def _edges(grouping: Grouping, zoom: int) -> Image:
    """Dark edge pixels on white."""
    return enlarge(np.where(grouping.edges.index >= 0, 30, 255).astype(np.uint8), zoom)


def _paint_over(canvas: Image, strokes: Strokes, zoom: int) -> Image:
    """Draw strokes given in pixels of the original on an image that is enlarged already."""
    moved = tuple((line + 0.5) * zoom - 0.5 for line in strokes.lines)
    return paint(canvas, Strokes(moved, strokes.colours))
