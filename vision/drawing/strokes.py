"""Drawings of what the stages of vision found: coloured polylines over an image, after the paper's figures.

What is drawn and how it is drawn are apart: the functions that end in ``_strokes`` give polylines in image
coordinates, which any viewer can show; :func:`paint` puts them onto an image.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import InputError
from vision.features import EllipseFeature, Extractor
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.grouping.edge_grouping import Grouping
from vision.model.contour import ModelContour
from vision.regions.segmentation import Region, Segmentation

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

EXTRACTOR_COLOURS: dict[Extractor, Colour] = {"region": (255, 170, 40), "group": (60, 190, 255)}
"""RGB of the ellipses of each extractor."""

SALIENT_COLOUR: Colour = (90, 255, 90)
"""RGB of the salient circles of a superimposed model."""

SUPPORTING_COLOUR: Colour = (40, 160, 60)
"""RGB of its supporting features."""

ELLIPSE_POINTS = 90
TICK_PX = 3.0
_GOLDEN_RATIO = (5**0.5 - 1) / 2
_SUBPIXEL_BITS = 4
_TITLE_HEIGHT_PX = 34
_MARGIN_PX = 8


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Strokes:
    """Coloured polylines over an image.

    Attributes:
        lines: each (N, 2) x, y in pixels, a whole number being the centre of a pixel; read-only.
        colours: (len(lines), 3) RGB; read-only.
    """

    lines: tuple[Array, ...]
    colours: Image

    def __post_init__(self) -> None:
        lines = tuple(np.array(line, dtype=float).reshape(-1, 2) for line in self.lines)
        colours = np.array(self.colours, dtype=np.uint8).reshape(-1, 3)
        if len(lines) != len(colours):
            raise InputError("strokes", got=f"{len(lines)} lines, {len(colours)} colours", expected="one for each")
        object.__setattr__(self, "lines", lines)
        object.__setattr__(self, "colours", colours)

    def __len__(self) -> int:
        return len(self.lines)

    def __add__(self, other: Strokes) -> Strokes:
        return Strokes(self.lines + other.lines, np.concatenate([self.colours, other.colours]))


def plain_strokes(lines: Iterable[ArrayLike], colour: Colour) -> Strokes:
    """Polylines of one colour."""
    arrays = tuple(np.asarray(line, dtype=float) for line in lines)
    return Strokes(arrays, np.tile(np.array(colour, np.uint8), (len(arrays), 1)))


def distinct_colours(n: int) -> Image:
    """RGB (n, 3) in which neighbours, and most others, differ: hues a golden ratio of the circle apart."""
    hue = np.arange(n) * _GOLDEN_RATIO % 1 * 180
    hsv = np.column_stack([hue, np.full(n, 190), np.full(n, 255)]).astype(np.uint8)
    return np.asarray(cv2.cvtColor(hsv[None], cv2.COLOR_HSV2RGB)[0], np.uint8) if n else np.zeros((0, 3), np.uint8)


def ellipse_strokes(features: Sequence[EllipseFeature]) -> Strokes:
    """The extracted ellipses in the colour of their extractor (Figs. 11 a, 11 b, 12 a)."""
    lines = tuple(_closed(feature.ellipse.sample(ELLIPSE_POINTS)) for feature in features)
    return Strokes(lines, np.array([EXTRACTOR_COLOURS[feature.extractor] for feature in features], np.uint8))


def region_strokes(regions: Sequence[Region], colours: Sequence[Colour] | Image | None = None) -> Strokes:
    """Outer and inner boundaries of regions, in a colour for each (Fig. 7): those given, or their own."""
    colours = region_colours(regions) if colours is None else np.array(colours, np.uint8).reshape(-1, 3)
    pairs = [
        (_closed(boundary), colour)
        for region, colour in zip(regions, colours, strict=True)
        for boundary in (region.contour, *region.holes)
    ]
    return Strokes(tuple(line for line, _ in pairs), np.array([colour for _, colour in pairs], np.uint8))


def region_colours(regions: Sequence[Region]) -> Image:
    """RGB (len(regions), 3), which a region keeps when others are pruned."""
    labels = [region.label for region in regions]
    return distinct_colours(max(labels, default=0) + 1)[labels]


def fragment_strokes(grouping: Grouping) -> Strokes:
    """Every smooth convex fragment in a colour of its own (Fig. 8 a)."""
    lines = tuple(fragment.points for fragment in grouping.fragments)
    return Strokes(lines, distinct_colours(len(lines)))


def group_strokes(grouping: Grouping) -> Strokes:
    """The fragments of every group in the group's colour (Fig. 8 b)."""
    fragments, groups = grouping.fragments, grouping.groups
    colours = distinct_colours(len(groups))
    members = [(number, colour) for group, colour in zip(groups, colours, strict=True) for number in group]
    lines = tuple(fragments[number].points for number, _ in members)
    return Strokes(lines, np.array([colour for _, colour in members], np.uint8))


def model_strokes(
    contour: ModelContour, T_world_part: Array, view: View, colours: Mapping[int, Colour] | None = None
) -> Strokes:
    """The circles of a vision model that face the camera, superimposed on a view (Figs. 11 c, 12 b).

    Args:
        contour: the sampled model.
        T_world_part: 4x4 pose.
        view: with a distortion-free lens.
        colours: RGB of the circles to draw, by number; None for all, salient ones brighter.
    """
    if colours is None:
        salient = contour.circle_salient.tolist()
        colours = {n: SALIENT_COLOUR if yes else SUPPORTING_COLOUR for n, yes in enumerate(salient)}
    projection = contour.project(T_world_part, view)
    circle = contour.circle[projection.index]
    lines, of_line = [], []
    for number in [n for n in np.unique(circle).tolist() if n in colours]:
        mine = np.flatnonzero(circle == number)
        if contour.circle_drawn[number]:
            ticks = _ticks(projection.pixels[mine], projection.normals[mine])
            lines += ticks
            of_line += [colours[number]] * len(ticks)
            continue
        samples = projection.index[mine]
        # Samples that turn away from the camera leave gaps, over which no line may run.
        runs = np.split(projection.pixels[mine], np.flatnonzero(np.diff(samples) > 1) + 1)
        if len(samples) == np.count_nonzero(contour.circle == number):
            runs = [_closed(runs[0])]
        lines += runs
        of_line += [colours[number]] * len(runs)
    return Strokes(tuple(lines), np.array(of_line, np.uint8))


def _ticks(pixels: Array, normals: Array) -> list[Array]:
    """A short line (2, 2) along the edge at each point of a pattern."""
    along = 0.5 * TICK_PX * np.column_stack([-normals[:, 1], normals[:, 0]])
    return list(np.stack([pixels - along, pixels + along], axis=1))


def paint(image: Image, strokes: Strokes, *, zoom: int = 1, thickness_px: int = 1) -> Image:
    """Draw strokes on an image.

    Args:
        image: uint8 (H, W) grey or (H, W, 3) RGB.
        strokes: what to draw; parts outside the image are left out.
        zoom: whole number by which the image is enlarged first, so that sub-pixel lines show.
        thickness_px: of the lines, in pixels of the enlarged image.

    Returns:
        RGB (zoom H, zoom W, 3).
    """
    canvas = enlarge(image, zoom)
    for line, colour in zip(strokes.lines, strokes.colours, strict=True):
        # Pixel centres are whole numbers before and after the enlargement; far outside, OpenCV's integers overflow.
        moved = np.clip((line + 0.5) * zoom - 0.5, -1e6, 1e6)
        points = np.rint(moved * 2**_SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(canvas, [points], False, colour.tolist(), thickness_px, cv2.LINE_AA, _SUBPIXEL_BITS)
    return canvas


def paint_regions(image: Image, segmentation: Segmentation, regions: Sequence[Region], *, zoom: int = 1) -> Image:
    """Fill regions with translucent colours and draw the leaves of their quadtree (Fig. 7).

    Args:
        image: uint8 (H, W) or (H, W, 3), the one that was segmented.
        segmentation: all of its regions.
        regions: those to draw.
        zoom: as in :func:`paint`; the leaves are drawn from 2 on.
    """
    table = np.zeros((len(segmentation.regions) + 1, 3), np.uint8)
    chosen = [region.label for region in regions]
    table[chosen] = region_colours(regions)
    labels = np.maximum(segmentation.labels, 0)
    filled = np.isin(labels, chosen)
    small = enlarge(image, 1)
    small[filled] = small[filled] // 2 + table[labels[filled]] // 2
    canvas = enlarge(small, zoom)
    if zoom > 1:
        leaves = segmentation.leaves[np.isin(segmentation.leaf_labels, chosen)]
        for x, y, size, label in (leaves[leaves[:, 2] > 1] * (zoom, zoom, zoom, 1)).tolist():
            cv2.rectangle(canvas, (x, y), (x + size - 1, y + size - 1), (table[label] * 0.6).tolist(), 1)
    return canvas


def enlarge(image: Image, zoom: int) -> Image:
    """A new RGB image, (zoom H, zoom W, 3), in which every pixel has become a square."""
    rgb = image if image.ndim == 3 else cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_GRAY2RGB)
    return np.ascontiguousarray(rgb.repeat(zoom, axis=0).repeat(zoom, axis=1))


def contact_sheet(panels: Mapping[str, Image], columns: int = 3, box_px: int = 640) -> Image:
    """Put panels beside each other, each under its title.

    Args:
        panels: RGB images by title, at least one.
        columns: panels in a row.
        box_px: side of the square into which each panel is fitted, however narrow it is.

    Raises:
        InputError: when there is no panel.
    """
    if not panels:
        raise InputError("contact sheet", got="no panels", expected="at least one")
    fitted = {title: fit_into(panel, box_px) for title, panel in panels.items()}
    height = max(panel.shape[0] for panel in fitted.values())
    cells = [_titled(title, panel, height, box_px) for title, panel in fitted.items()]
    columns = min(columns, len(cells))
    cells += [np.full_like(cells[0], 255)] * (-len(cells) % columns)
    rows = [np.hstack(cells[start : start + columns]) for start in range(0, len(cells), columns)]
    return np.vstack(rows)


def fit_into(image: Image, box_px: int) -> Image:
    """An image enlarged or reduced until its longer side is that of a square."""
    height, width = image.shape[:2]
    scale = box_px / max(height, width)
    size = (max(1, round(scale * width)), max(1, round(scale * height)))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST))


def _titled(title: str, panel: Image, height: int, width: int) -> Image:
    cell = np.full((height + _TITLE_HEIGHT_PX + _MARGIN_PX, width + 2 * _MARGIN_PX, 3), 255, np.uint8)
    left = _MARGIN_PX + (width - panel.shape[1]) // 2
    cell[_TITLE_HEIGHT_PX : _TITLE_HEIGHT_PX + panel.shape[0], left : left + panel.shape[1]] = panel
    baseline = (_MARGIN_PX, _TITLE_HEIGHT_PX - 11)
    cv2.putText(cell, title, baseline, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 40, 40), 1, cv2.LINE_AA)
    return cell


def _closed(points: ArrayLike) -> Array:
    """The polyline back to its first point."""
    array = np.asarray(points, dtype=float)
    return np.concatenate([array, array[:1]])
