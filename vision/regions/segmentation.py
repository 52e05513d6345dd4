"""Segmentation (Section 5.1): an image becomes regions with their quadtree description and attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import GRADIENT_UNIT, as_gray, image_gradients
from vision.features import RegionAttributes
from vision.frozen import frozen_arrays, read_only
from vision.kernels import njit
from vision.regions.attributes import AttributeConstraints, Contour, measure_shape
from vision.regions.contours import trace_contours
from vision.regions.edge_gaps import link_edges
from vision.regions.merging import BOUNDARY, merge
from vision.regions.quadtree import Labels, Quadtree, SplitAndMergeParameters, split
from vision.settings import NOT_NEGATIVE, Allowed, check, count


@dataclass(frozen=True)
class RegionGrowingParameters:
    """How regions are grown.

    Attributes:
        blur_px: standard deviation of the Gaussian before edge detection, in pixels.
        edge_low: lower hysteresis threshold of Canny, on the gradient in grey levels per pixel.
        edge_high: upper one.
        gap_px: longest gap that edge linking closes, in pixels.
        split_and_merge: what counts as homogeneous and similar.
    """

    blur_px: float = 1.0
    edge_low: float = 3.0
    edge_high: float = 8.0
    gap_px: int = 3
    split_and_merge: SplitAndMergeParameters = field(default_factory=SplitAndMergeParameters)

    def __post_init__(self) -> None:
        check(self, blur_px=Allowed(0, 100, above=True), edge_low=NOT_NEGATIVE, gap_px=count())
        check(self, edge_high=Allowed(self.edge_low))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Region:
    """A connected homogeneous region without edge pixels.

    Attributes:
        label: its number in the label image, from 1.
        attributes: area, perimeter, circularity, shape complexity, mean grey and deviation.
        box: (x, y, width, height) in pixels.
        contour: (N, 2) its outer boundary pixels (x, y) in order; read-only.
        holes: the same for each inner boundary, such as the inner rim of a ring; pixels of this region.
        leaves: (M,) indices of its leaves in the quadtree, the quadtree description; read-only.
    """

    label: int
    attributes: RegionAttributes
    box: tuple[int, int, int, int]
    contour: Contour
    holes: tuple[Contour, ...]
    leaves: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Segmentation:
    """An image divided into regions and the boundaries between them.

    Attributes:
        labels: (H, W) int32, the label of each pixel's region, or ``region_merging.BOUNDARY`` on edge pixels and on
            specks too small to be a region; read-only. Edge pixels stay boundary, for they belong to both sides.
        tree: the quadtree, its leaves in the order that regions refer to.
        leaf_labels: (N,) int32 label of each leaf; read-only.
        edges: (H, W) linked edge map; read-only.
        gray: (H, W) uint8, the image that was segmented; read-only.
        parameters: with which it was.
    """

    labels: Labels
    tree: Quadtree
    leaf_labels: Labels
    edges: NDArray[np.bool_]
    gray: NDArray[np.uint8]
    parameters: RegionGrowingParameters

    @cached_property
    def leaves(self) -> Labels:
        """(N, 4) int32 x, y, size and label of each leaf, as drawn in Fig. 7 a."""
        return read_only(np.column_stack([self.tree.x, self.tree.y, self.tree.size, self.leaf_labels]))

    @cached_property
    def regions(self) -> tuple[Region, ...]:
        """Every region, ``regions[k].label == k + 1``."""
        return self.prune(AttributeConstraints())

    def prune(self, constraints: AttributeConstraints) -> tuple[Region, ...]:
        """The regions that the constraints leave, as ``constraints.prune(self.regions)`` (Fig. 7 b).

        What the quadtree alone tells goes first: only the regions that are still left have their contours traced.
        """
        sums = _sum_leaves(self.leaf_labels, self.tree)
        left = constraints.hold(area_px=sums.area, grey_mean=sums.grey_mean, grey_deviation=sums.grey_deviation)
        left[BOUNDARY] = False
        contours = trace_contours(self.labels, left)
        bounds = zip(contours.ends[:-1].tolist(), contours.ends[1:].tolist(), strict=True)
        of_label: dict[int, list[Contour]] = {}
        for label, (start, end) in zip(contours.labels.tolist(), bounds, strict=True):
            of_label.setdefault(label, []).append(contours.points[start:end])
        regions = (sums.region(label, of_label[label]) for label in np.flatnonzero(left).tolist())
        return tuple(constraints.prune(regions))


def segment(gray: NDArray[np.generic], parameters: RegionGrowingParameters | None = None) -> Segmentation:
    """Divide an image into homogeneous regions: Canny, edge linking, split and merge.

    Args:
        gray: (H, W) uint8 grey levels; (H, W, 3) RGB is converted.
        parameters: of the method; None for the defaults.

    Returns:
        The segmentation. A constant image is one region, an empty one has none.

    Raises:
        InputError: when ``gray`` is not an image, see :func:`vision.edges.edge_map.as_gray`.
    """
    parameters = parameters or RegionGrowingParameters()
    image = as_gray(gray).copy()  # what the caller does with his array later must not reach the segmentation
    if image.size == 0:
        nothing = np.zeros(image.shape, np.int32)
        tree = split(image, nothing > 0, parameters.split_and_merge)
        return Segmentation(nothing, tree, nothing.ravel(), nothing > 0, image, parameters)
    edges = link_edges(canny(image, parameters), parameters.gap_px)
    tree = split(image, edges, parameters.split_and_merge)
    leaf_labels = merge(tree, parameters.split_and_merge)
    return Segmentation(leaf_labels.take(tree.leaf_of_pixel), tree, leaf_labels, edges, image, parameters)


def canny(gray: NDArray[np.uint8], parameters: RegionGrowingParameters) -> NDArray[np.bool_]:
    """Canny edges of the blurred image (H, W)."""
    dx, dy = image_gradients(gray, parameters.blur_px)
    low, high = parameters.edge_low * GRADIENT_UNIT, parameters.edge_high * GRADIENT_UNIT
    return np.asarray(cv2.Canny(dx, dy, low, high, L2gradient=True) > 0)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Sums:
    """What the leaves of each label add up to; all but the first two have one entry or row for each label from 0.

    Attributes:
        leaves: (N,) the leaves, label by label.
        starts: (labels + 1,) where each label's begin.
        box: left, top, right and bottom, the last two not included.
        area: pixels.
        grey_mean: mean grey level.
        grey_deviation: its standard deviation.
    """

    leaves: NDArray[np.intp]
    starts: NDArray[np.intp]
    box: Labels
    area: NDArray[np.float64]
    grey_mean: NDArray[np.float64]
    grey_deviation: NDArray[np.float64]

    def region(self, label: int, contours: list[Contour]) -> Region:
        """The region of a label, whose outer contour comes first."""
        area = float(self.area[label])
        attributes = RegionAttributes(
            area, *measure_shape(contours[0], area), float(self.grey_mean[label]), float(self.grey_deviation[label])
        )
        left, top, right, bottom = self.box[label].tolist()
        leaves = self.leaves[self.starts[label] : self.starts[label + 1]]
        return Region(
            label, attributes, (left, top, right - left, bottom - top), contours[0], tuple(contours[:0:-1]), leaves
        )


def _sum_leaves(leaf_labels: Labels, tree: Quadtree) -> _Sums:
    """Area, grey levels and boxes of all labels."""
    count = int(leaf_labels.max(initial=0)) + 1
    leaves, starts, box, sums = _sums(
        leaf_labels, tree.x, tree.y, tree.size, tree.grey_sum, tree.grey_square_sum, count
    )
    area = sums[:, 0]
    mean = sums[:, 1] / np.maximum(area, 1)
    deviation = np.sqrt(np.maximum(sums[:, 2] / np.maximum(area, 1) - mean**2, 0))
    return _Sums(leaves, starts, box, area, mean, deviation)


@njit(cache=True)
def _sums(leaf_labels, x, y, size, grey_sum, grey_square_sum, count):
    """Leaves sorted by label, where each label starts, boxes (count, 4), sums of area, grey and its square."""
    starts = np.zeros(count + 1, np.intp)
    box = np.zeros((count, 4), np.int32)
    box[:, :2] = 2**30
    sums = np.zeros((count, 3))
    for i in range(len(leaf_labels)):
        label = leaf_labels[i]
        starts[label + 1] += 1
        box[label, 0], box[label, 1] = min(box[label, 0], x[i]), min(box[label, 1], y[i])
        box[label, 2], box[label, 3] = max(box[label, 2], x[i] + size[i]), max(box[label, 3], y[i] + size[i])
        sums[label, 0] += float(size[i]) ** 2
        sums[label, 1] += grey_sum[i]
        sums[label, 2] += grey_square_sum[i]
    starts = np.cumsum(starts)
    leaves, after = np.empty(len(leaf_labels), np.intp), starts.copy()
    for i in range(len(leaf_labels)):
        leaves[after[leaf_labels[i]]] = i
        after[leaf_labels[i]] += 1
    return leaves, starts, box, sums
