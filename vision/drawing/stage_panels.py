"""Drawings of the single stages: what region growing, edge grouping and matching found in one picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from vision.drawing.filter_history import filter_history
from vision.drawing.panel import Canvas, Panel, with_legend
from vision.drawing.strokes import (
    Colour,
    Image,
    Strokes,
    ellipse_strokes,
    enlarge,
    fragment_strokes,
    group_strokes,
    model_strokes,
    paint_regions,
    plain_strokes,
    region_strokes,
)
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.ellipse import Ellipse
from vision.grouping.edge_grouping import Grouping
from vision.grouping.kalman_filter import moment_estimate
from vision.model.contour import ModelContour
from vision.pose.estimate import PoseEstimate
from vision.regions.attributes import AttributeConstraints
from vision.regions.segmentation import Region, Segmentation

FILTER_POINTS = (4, 8, 16, 32, 64)
"""After how many points the state of the filter is drawn."""

WHITE: Colour = (255, 255, 255)
HALF_RESOLUTION_COLOUR: Colour = (255, 225, 110)
PRUNED_COLOURS: dict[str, Colour] = {
    "area_px": (110, 150, 255),
    "perimeter_px": (255, 190, 60),
    "grey_mean": (255, 100, 100),
}
OTHERWISE_PRUNED_COLOUR: Colour = (200, 130, 255)

_ATTRIBUTE_WORDS = {
    "area_px": "area",
    "perimeter_px": "perimeter",
    "circularity": "circularity",
    "shape_complexity": "shape complexity",
    "grey_mean": "mean grey level",
    "grey_deviation": "grey deviation",
}


def edges(canvas: Canvas, index: NDArray[np.bool_], found: str) -> Panel:
    """Dark edge pixels on white."""
    return Panel("1_edges", f"Edges: {found}", enlarge(np.where(index, 30, 255).astype(np.uint8), canvas.zoom))


def regions(canvas: Canvas, segmentation: Segmentation) -> Panel:
    """Every region filled, over the leaves of its quadtree (Fig. 7 a)."""
    found = segmentation.regions
    image = paint_regions(canvas.gray, segmentation, found, zoom=canvas.zoom)
    return Panel("2_regions", f"Region growing: {len(found)} regions", image)


def pruned_regions(canvas: Canvas, segmentation: Segmentation, constraints: AttributeConstraints | None) -> Panel:
    """The regions that the attribute constraints leave, filled, and the outlines of the others (Fig. 7 b).

    The colour of an outline says which attribute rules the region out, the first one where several do.
    """
    constraints = constraints or AttributeConstraints()
    broken = [(region, constraints.violations(region.attributes)) for region in segmentation.regions]
    kept = [region for region, violations in broken if not violations]
    out = [(region, *next(iter(violations.items()))) for region, violations in broken if violations]
    outlines = region_strokes([region for region, _, _ in out], [_pruned_colour(name) for _, name, _ in out])
    filled = paint_regions(canvas.faded, segmentation, kept, zoom=canvas.zoom)
    counts = Counter((name, side) for _, name, side in out)
    legend = [
        (f"{_ATTRIBUTE_WORDS[name]} too {side}: {count}", _pruned_colour(name))
        for (name, side), count in sorted(counts.items())
    ]
    image = with_legend(canvas.drawn((outlines, 1), on=filled), legend)
    return Panel("2b_pruned_regions", f"Pruned by attributes: {len(kept)} of {len(broken)} regions left", image)


def region_ellipses(
    canvas: Canvas, segmentation: Segmentation, ellipses: Sequence[EllipseFeature], left: Sequence[Region]
) -> Panel:
    """The regions, of those left, on whose boundaries ellipses were found."""
    bounded = {feature.attributes for feature in ellipses}
    kept = [region for region in left if region.attributes in bounded]
    filled = paint_regions(canvas.faded, segmentation, kept)
    image = canvas.drawn((ellipse_strokes(ellipses), 1), on=enlarge(filled, canvas.zoom))
    return Panel("3_region_ellipses", f"Regions with an elliptic boundary: {len(ellipses)} ellipses", image)


def fragments(canvas: Canvas, grouping: Grouping) -> Panel:
    """Every smooth convex fragment in a colour of its own (Fig. 8 a)."""
    image = canvas.drawn((fragment_strokes(grouping), 1))
    return Panel("4_fragments", f"Edge grouping: {len(grouping.table)} fragments", image)


def groups(canvas: Canvas, grouping: Grouping, coarse: Sequence[Ellipse] = ()) -> Panel:
    """The fragments of every group in its colour, and all ellipses (Figs. 8 b, 9 c).

    Args:
        canvas: to draw on.
        grouping: its features are those to draw.
        coarse: ellipses that only a look at half the resolution found.
    """
    outlines = plain_strokes(ellipse_strokes(grouping.features).lines, WHITE)
    others = plain_strokes((_ring(ellipse) for ellipse in coarse), HALF_RESOLUTION_COLOUR)
    image = _thin(canvas, outlines + others, canvas.drawn((group_strokes(grouping), 2)))
    title = f"Groups of fragments: {len(grouping.features) + len(coarse)} ellipses"
    if coarse:
        image = with_legend(image, [("found at half the resolution", HALF_RESOLUTION_COLOUR)])
        title += f", {len(coarse)} at half the resolution"
    return Panel("5_groups", title, image)


def kalman_filter(canvas: Canvas, features: Sequence[EllipseFeature]) -> Panel:
    """The estimate of the Kalman filter, from orange before the first point to white after all."""
    title = "Kalman filter: the best ellipse after more and more points"
    if not features:
        return Panel("6_filter", title, canvas.drawn())
    best = max(features, key=lambda f: len(f.points) * f.score)
    points = best.points[np.random.default_rng(0).permutation(len(best.points))]
    start = moment_estimate(points)
    states = list(filter_history(points, start))
    shown = [states[min(n, len(states)) - 1] for n in FILTER_POINTS if n <= len(states)] + states[-1:]
    lines = tuple(_ring(ellipse) for ellipse in (Ellipse(start), *(state.ellipse for state in shown)))
    shades = np.linspace(0, 1, len(lines))
    colours = np.array([(255, 140 + 115 * s, 255 * s) for s in shades], np.uint8)
    return Panel("6_filter", title, canvas.drawn((Strokes(lines, colours), 1)))


def supporting_features(
    canvas: Canvas, view: View, estimates: Sequence[PoseEstimate], contours: Mapping[str, ModelContour]
) -> Panel:
    """The salient circles of every pose, and the supporting features by how well edges run along them (Fig. 9 d)."""
    salient, supporting = _no_strokes(), _no_strokes()
    for estimate in estimates:
        contour, T = contours[estimate.part], estimate.T_world_part.as_matrix()
        circles = dict.fromkeys(np.flatnonzero(contour.circle_salient).tolist(), WHITE)
        salient += model_strokes(contour, T, view, circles)
        supporting += model_strokes(contour, T, view, _by_support(estimate))
    told = [f for estimate in estimates for f in estimate.features if f.role == "supporting"]
    image = _thin(canvas, salient, canvas.drawn((supporting, 1)))
    legend = [(f"edge support {s:g}", support_colour(s)) for s in (1.0, 0.5, 0.0)]
    confirmed, in_sight = sum(f.confirmed for f in told), sum(f.in_sight for f in told)
    title = f"Supporting features: {confirmed} of {in_sight} in sight confirmed"
    return Panel("7_supporting_features", title, with_legend(image, legend))


def poses(
    canvas: Canvas, view: View, estimates: Sequence[PoseEstimate], contours: Mapping[str, ModelContour]
) -> Panel:
    """The model, superimposed in its final poses (Figs. 11 c, 12 b)."""
    strokes = _no_strokes()
    for estimate in estimates:
        strokes += model_strokes(contours[estimate.part], estimate.T_world_part.as_matrix(), view)
    image = canvas.drawn((strokes, 1), on=canvas.plain)
    return Panel("8_poses", f"Superimposed model: {len(estimates)} poses", image)


def support_colour(support: float) -> Colour:
    """From red without edges over yellow to green with edges all along."""
    return round(255 * min(1.0, 2 - 2 * support)), round(255 * min(1.0, 2 * support)), 60


def _by_support(estimate: PoseEstimate) -> dict[int, Colour]:
    """Colours of the copies in sight of supporting features, by number of the circle."""
    copies = chain.from_iterable(((f.role, support) for support in f.copies) for f in estimate.features)
    return {
        number: support_colour(support)
        for number, (role, support) in enumerate(copies)
        if role == "supporting" and support is not None
    }


def _pruned_colour(attribute: str) -> Colour:
    return PRUNED_COLOURS.get(attribute, OTHERWISE_PRUNED_COLOUR)


def _thin(canvas: Canvas, strokes: Strokes, on: Image) -> Image:
    """Lines one pixel wide, also where everything else is enlarged."""
    unzoomed = Canvas(canvas.gray, 1)
    moved = Strokes(tuple((line + 0.5) * canvas.zoom - 0.5 for line in strokes.lines), strokes.colours)
    return unzoomed.drawn((moved, 1), on=on)


def _ring(ellipse: Ellipse) -> NDArray[np.float64]:
    ring = ellipse.sample(120)
    return np.vstack([ring, ring[:1]])


def _no_strokes() -> Strokes:
    return Strokes((), np.zeros((0, 3), np.uint8))
