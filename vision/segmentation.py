"""Segmentation (Section 5.1): an image becomes regions with their quadtree description and attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edge_linking import link_edges
from vision.errors import InputError
from vision.features import RegionAttributes
from vision.quadtree import Labels, Quadtree, SplitAndMerge, merge, split
from vision.region_attributes import Contour, measure_shape


@dataclass(frozen=True)
class RegionGrowing:
    """Settings of the region-growing method.

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
    split_and_merge: SplitAndMerge = field(default_factory=SplitAndMerge)

    def __post_init__(self) -> None:
        if not 0 < self.blur_px < 100:
            raise InputError("blur_px", got=self.blur_px, expected="a standard deviation in pixels, > 0")
        if not 0 <= self.edge_low <= self.edge_high:
            raise InputError("edge thresholds", got=(self.edge_low, self.edge_high), expected="0 <= low <= high")


@dataclass(frozen=True, eq=False)
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

    def __post_init__(self) -> None:
        arrays: tuple[NDArray, ...] = (self.contour, *self.holes, self.leaves)
        for a in arrays:
            a.flags.writeable = False

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the arrays stay read-only."""
        return (Region, (self.label, self.attributes, self.box, self.contour, self.holes, self.leaves))


@dataclass(frozen=True, eq=False)
class Segmentation:
    """An image divided into regions and the boundaries between them.

    Attributes:
        labels: (H, W) int32, the label of each pixel's region, or ``quadtree.BOUNDARY`` on edge pixels and on
            specks too small to be a region; read-only. Edge pixels stay boundary, for they belong to both sides.
        tree: the quadtree, its leaves in the order that regions refer to.
        leaf_labels: (N,) int32 label of each leaf; read-only.
        regions: every region, ``regions[k].label == k + 1``.
        edges: (H, W) linked edge map; read-only.
    """

    labels: Labels
    tree: Quadtree
    leaf_labels: Labels
    regions: tuple[Region, ...]
    edges: NDArray[np.bool_]

    def __post_init__(self) -> None:
        arrays: tuple[NDArray, ...] = (self.labels, self.leaf_labels, self.edges)
        for a in arrays:
            a.flags.writeable = False

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the arrays stay read-only."""
        return (Segmentation, (self.labels, self.tree, self.leaf_labels, self.regions, self.edges))

    @cached_property
    def leaves(self) -> Labels:
        """(N, 4) int32 x, y, size and label of each leaf, as drawn in Fig. 7 a."""
        return np.column_stack([self.tree.x, self.tree.y, self.tree.size, self.leaf_labels])


def segment(gray: NDArray[np.uint8], settings: RegionGrowing | None = None) -> Segmentation:
    """Divide an image into homogeneous regions: Canny, edge linking, split and merge.

    Args:
        gray: (H, W) uint8 grey levels.
        settings: of the method; None for the defaults.

    Returns:
        The segmentation. A constant image is one region.

    Raises:
        InputError: when the image is not a non-empty two-dimensional uint8 array.
    """
    settings = settings or RegionGrowing()
    gray = check_gray(gray)
    edges = link_edges(canny(gray, settings), settings.gap_px)
    tree = split(gray, edges, settings.split_and_merge)
    leaf_labels = merge(tree, settings.split_and_merge)
    labels = leaf_labels[tree.leaf_of_pixel]
    return Segmentation(labels, tree, leaf_labels, _describe(labels, tree, leaf_labels), edges)


def check_gray(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image as a contiguous array, once it is known to be one of grey levels.

    Raises:
        InputError: when it is not.
    """
    image = np.asarray(gray)
    if image.dtype != np.uint8 or image.ndim != 2 or image.size == 0:
        raise InputError(
            "image",
            got=f"{image.dtype} {image.shape}",
            expected="grey levels, uint8 (H, W), at least 1 x 1",
            do="Convert colour with cv2.cvtColor, and floating-point images by scaling to 0..255",
        )
    return np.ascontiguousarray(image)


def gradient(gray: NDArray[np.uint8], blur_px: float) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Gradient (H, W) along x and y of the blurred image, in 1/32 grey level per pixel."""
    # Blurring 8 bits rounds to whole levels; four times the levels in 16 bits keep smooth ramps smooth.
    blurred = cv2.GaussianBlur(gray.astype(np.int16) * 4, (0, 0), blur_px)
    return cv2.Sobel(blurred, cv2.CV_16S, 1, 0), cv2.Sobel(blurred, cv2.CV_16S, 0, 1)


def canny(gray: NDArray[np.uint8], settings: RegionGrowing) -> NDArray[np.bool_]:
    """Canny edges of the blurred image (H, W)."""
    dx, dy = gradient(gray, settings.blur_px)
    return np.asarray(cv2.Canny(dx, dy, settings.edge_low * 32, settings.edge_high * 32, L2gradient=True) > 0)


def _describe(labels: Labels, tree: Quadtree, leaf_labels: Labels) -> tuple[Region, ...]:
    """Attributes, box, contours and quadtree description of every region."""
    count = int(leaf_labels.max(initial=0))
    leaf_area = tree.size.astype(float) ** 2
    area = np.bincount(leaf_labels, leaf_area, count + 1)
    mean = np.bincount(leaf_labels, tree.grey_sum, count + 1) / np.maximum(area, 1)
    square_mean = np.bincount(leaf_labels, tree.grey_square_sum, count + 1) / np.maximum(area, 1)
    deviation = np.sqrt(np.maximum(square_mean - mean**2, 0))
    by_label = np.argsort(leaf_labels, kind="stable")
    starts = np.searchsorted(leaf_labels[by_label], np.arange(count + 2))
    boxes = _boxes(tree, by_label, starts[1:-1])
    regions = []
    for label in range(1, count + 1):
        leaves = by_label[starts[label] : starts[label + 1]]
        left, top, right, bottom = boxes[label - 1]
        mask = labels[top:bottom, left:right] == label
        contour, holes = _contours(mask, left, top)
        attributes = RegionAttributes(
            float(area[label]),
            *measure_shape(contour, float(area[label])),
            float(mean[label]),
            float(deviation[label]),
        )
        regions.append(Region(label, attributes, (left, top, right - left, bottom - top), contour, holes, leaves))
    return tuple(regions)


def _boxes(tree: Quadtree, by_label: NDArray[np.intp], starts: NDArray[np.intp]) -> list[list[int]]:
    """Left, top, right and bottom (the last two not included) of each region, whose leaves begin at ``starts``."""
    if not len(starts):
        return []
    x, y, size = tree.x[by_label], tree.y[by_label], tree.size[by_label]
    low = [np.minimum.reduceat(a, starts) for a in (x, y)]
    high = [np.maximum.reduceat(a + size, starts) for a in (x, y)]
    boxes: list[list[int]] = np.column_stack(low + high).tolist()
    return boxes


def _contours(mask: NDArray[np.bool_], left: int, top: int) -> tuple[Contour, tuple[Contour, ...]]:
    """Outer boundary and inner boundaries (N, 2) of a mask whose upper left pixel is (left, top)."""
    found, hierarchy = cv2.findContours(
        mask.view(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE, offset=(left, top)
    )
    outer = int(np.flatnonzero(hierarchy[0, :, 3] < 0)[0])
    contours = [c.reshape(-1, 2) for c in found]
    return contours[outer], tuple(c for i, c in enumerate(contours) if i != outer)
