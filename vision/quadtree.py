"""Split and merge over a quadtree (Section 5.1): homogeneous blocks without edge pixels, grown into regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.errors import InputError

Labels = NDArray[np.int32]

BOUNDARY = 0
"""Label of the pixels that belong to no region: edge pixels, and specks too small to be regions."""


@dataclass(frozen=True)
class SplitAndMerge:
    """What counts as homogeneous and as similar, in grey levels.

    Attributes:
        max_deviation: largest standard deviation of the grey level within a homogeneous block.
        max_range: largest difference of two grey levels within a homogeneous block.
        max_step: largest difference of the means of two neighbouring blocks that may be merged.
        max_contrast: largest difference of the means of two regions that may be merged.
        min_area_px: smaller regions go to the most similar neighbour that no edge separates them from.
        root_size_px: side of the largest blocks; a power of two.
    """

    max_deviation: float = 6.0
    max_range: float = 32.0
    max_step: float = 16.0
    max_contrast: float = 40.0
    min_area_px: int = 32
    root_size_px: int = 64

    def __post_init__(self) -> None:
        thresholds = (self.max_deviation, self.max_range, self.max_step, self.max_contrast, self.min_area_px)
        if not all(t >= 0 for t in thresholds):
            raise InputError("split-and-merge thresholds", got=thresholds, expected="numbers >= 0")
        if self.root_size_px < 1 or self.root_size_px & (self.root_size_px - 1):
            raise InputError("root_size_px", got=self.root_size_px, expected="a power of two")


@dataclass(frozen=True, eq=False)
class Quadtree:
    """The leaves of a split image: squares that cover every pixel exactly once.

    Attributes:
        leaf_of_pixel: (H, W) int32 index of the leaf that a pixel lies in.
        x: (N,) int32 left column of each leaf.
        y: (N,) int32 top row.
        size: (N,) int32 side in pixels, a power of two.
        is_edge: (N,) whether the leaf is a single edge pixel.
        grey_sum: (N,) sum of the grey levels.
        grey_square_sum: (N,) sum of their squares.

    All arrays are read-only.
    """

    leaf_of_pixel: Labels
    x: Labels
    y: Labels
    size: Labels
    is_edge: NDArray[np.bool_]
    grey_sum: NDArray[np.float64]
    grey_square_sum: NDArray[np.float64]

    def __post_init__(self) -> None:
        for a in vars(self).values():
            a.flags.writeable = False

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the arrays stay read-only."""
        return (Quadtree, tuple(vars(self).values()))

    def __len__(self) -> int:
        return len(self.x)


def split(gray: NDArray[np.uint8], edges: NDArray[np.bool_], settings: SplitAndMerge) -> Quadtree:
    """Split the image until every block is homogeneous: no edge pixel inside, small grey deviation and range.

    Args:
        gray: (H, W) grey levels.
        edges: (H, W) edge map, as linked.
        settings: thresholds.

    Returns:
        The leaves, largest first. Single pixels are always leaves where nothing larger is homogeneous.
    """
    leaf_of_pixel, *of_leaf = _split(
        np.ascontiguousarray(gray),
        np.ascontiguousarray(edges),
        settings.root_size_px.bit_length() - 1,
        float(settings.max_deviation**2),
        float(settings.max_range),
    )
    return Quadtree(leaf_of_pixel, *of_leaf)


@njit(cache=True)
def _split(gray, edges, depth, max_variance, max_range):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The arrays of the :class:`Quadtree` whose largest blocks have the side 2 ** ``depth``."""
    height, width = gray.shape
    leaf_of_pixel = np.full((height, width), -1, np.int32)
    # Blocks that reach over the image are never whole, so that only those inside need to be looked at.
    sums = [_quarter_pixels(gray, edges)]
    for _ in range(1, depth):
        sums.append(_quarter(sums[-1]))
    x, y, size = np.empty(gray.size, np.int32), np.empty(gray.size, np.int32), np.empty(gray.size, np.int32)
    total, square_total = np.empty(gray.size), np.empty(gray.size)
    n = 0
    for level in range(depth, 0, -1):
        side = 1 << level
        blocks = sums[level - 1]
        for row in range(blocks.shape[0]):
            for column in range(blocks.shape[1]):
                if leaf_of_pixel[row * side, column * side] >= 0:
                    continue
                block = blocks[row, column]
                mean = block[0] / (side * side)
                if block[3] - block[2] > max_range or block[1] / (side * side) - mean * mean > max_variance:
                    continue
                leaf_of_pixel[row * side : (row + 1) * side, column * side : (column + 1) * side] = n
                x[n], y[n], size[n], total[n], square_total[n] = column * side, row * side, side, block[0], block[1]
                n += 1
    whole = n
    for row in range(height):
        for column in range(width):
            if leaf_of_pixel[row, column] < 0:
                leaf_of_pixel[row, column] = n
                grey = float(gray[row, column])
                x[n], y[n], size[n], total[n], square_total[n] = column, row, 1, grey, grey * grey
                n += 1
    is_edge = np.zeros(n, np.bool_)
    for leaf in range(whole, n):
        is_edge[leaf] = edges[y[leaf], x[leaf]]
    return leaf_of_pixel, x[:n].copy(), y[:n].copy(), size[:n].copy(), is_edge, total[:n].copy(), square_total[:n].copy()


@njit(cache=True)
def _quarter_pixels(gray, edges):  # type: ignore[no-untyped-def]  # pragma: no cover
    """(H / 2, W / 2, 4) sum, sum of squares, least and greatest grey of blocks of four pixels.

    A block with an edge pixel has the greatest grey infinity, so that no such block is homogeneous.
    """
    blocks = np.empty((gray.shape[0] // 2, gray.shape[1] // 2, 4))
    for row in range(blocks.shape[0]):
        for column in range(blocks.shape[1]):
            v, u = 2 * row, 2 * column
            a, b, c, d = int(gray[v, u]), int(gray[v, u + 1]), int(gray[v + 1, u]), int(gray[v + 1, u + 1])
            blocked = edges[v, u] | edges[v, u + 1] | edges[v + 1, u] | edges[v + 1, u + 1]
            blocks[row, column, 0] = a + b + c + d
            blocks[row, column, 1] = a * a + b * b + c * c + d * d
            blocks[row, column, 2] = min(min(a, b), min(c, d))
            blocks[row, column, 3] = np.inf if blocked else max(max(a, b), max(c, d))
    return blocks


@njit(cache=True)
def _quarter(blocks):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The same sums over four blocks each."""
    quarters = np.empty((blocks.shape[0] // 2, blocks.shape[1] // 2, 4))
    for row in range(quarters.shape[0]):
        for column in range(quarters.shape[1]):
            a, b = blocks[2 * row, 2 * column], blocks[2 * row, 2 * column + 1]
            c, d = blocks[2 * row + 1, 2 * column], blocks[2 * row + 1, 2 * column + 1]
            quarters[row, column, 0] = a[0] + b[0] + c[0] + d[0]
            quarters[row, column, 1] = a[1] + b[1] + c[1] + d[1]
            quarters[row, column, 2] = min(min(a[2], b[2]), min(c[2], d[2]))
            quarters[row, column, 3] = max(max(a[3], b[3]), max(c[3], d[3]))
    return quarters


def merge(tree: Quadtree, settings: SplitAndMerge) -> Labels:
    """Merge neighbouring leaves of similar grey into regions, the most similar pair first.

    Two leaves are neighbours when they share a side (edges are 8-connected, so that sharing a corner would let
    a region slip through a diagonal edge) and neither is an edge pixel. Their regions merge while the means of
    both the leaves and the regions are close. What is left smaller than ``min_area_px`` joins its most similar
    neighbour, if an edge does not enclose it.

    Returns:
        (N,) label of each leaf: ``BOUNDARY``, or 1, 2, ... in the order of the leaves.
    """
    area = tree.size.astype(float) ** 2
    mean = np.where(tree.is_edge, np.nan, tree.grey_sum / area)
    first, second, similar = _neighbour_pairs(tree.leaf_of_pixel, mean, float(settings.max_step))
    root = _unite(
        first,
        second,
        similar,
        area.copy(),
        tree.grey_sum.copy(),
        float(settings.max_contrast),
        float(settings.min_area_px),
    )
    return _number_regions(tree, root, settings.min_area_px)


@njit(cache=True)
def _neighbour_pairs(leaf, mean, max_step):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Pairs of leaves that share a side, sorted by the step between their means, and how many have a small step.

    A pair is repeated for each pixel of the side. Leaves whose mean is NaN have no neighbours. The sort counts
    steps in units of 1 / 64 grey level, finer than any threshold, and leaves equal steps in the order of the image.
    """
    height, width = leaf.shape
    first, second = np.empty(2 * leaf.size, np.int32), np.empty(2 * leaf.size, np.int32)
    key = np.empty(2 * leaf.size, np.uint16)
    after = np.zeros(256 * 64 + 1, np.int64)
    n = 0
    for dy, dx in ((0, 1), (1, 0)):
        for y in range(height - dy):
            for x in range(width - dx):
                a, b = leaf[y, x], leaf[y + dy, x + dx]
                if a != b:
                    step = abs(mean[a] - mean[b])
                    if step >= 0:
                        first[n], second[n], key[n] = a, b, int(step * 64)
                        after[key[n] + 1] += 1
                        n += 1
    after = np.cumsum(after)
    similar = after[min(int(max_step * 64) + 1, len(after) - 1)]
    sorted_first, sorted_second = np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(n):
        place = after[key[i]]
        sorted_first[place], sorted_second[place] = first[i], second[i]
        after[key[i]] += 1
    return sorted_first, sorted_second, similar


@njit(cache=True)
def _find(root, i):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Root of a leaf, halving the path on the way."""
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@njit(cache=True)
def _unite(first, second, similar, area, total, max_contrast, min_area):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Root (N,) of each leaf by union-find over the pairs in order; ``area`` and ``total`` become those of the roots.

    The first ``similar`` pairs join by contrast, then all by lack of area.
    """
    root = np.arange(len(area)).astype(np.int32)
    for pass_ in range(2):
        for k in range(similar if pass_ == 0 else len(first)):
            a, b = _find(root, first[k]), _find(root, second[k])
            if a == b:
                continue
            if pass_ == 0:
                join = abs(total[a] / area[a] - total[b] / area[b]) <= max_contrast
            else:
                join = min(area[a], area[b]) < min_area
            if join:
                if area[a] < area[b]:
                    a, b = b, a
                root[b] = a
                area[a] += area[b]
                total[a] += total[b]
    for i in range(len(root)):
        root[i] = _find(root, i)
    return root


def _number_regions(tree: Quadtree, root: Labels, min_area: int) -> Labels:
    """Consecutive labels for the regions that are large enough."""
    area = np.bincount(root, weights=tree.size.astype(float) ** 2, minlength=len(root))
    # An image smaller than the smallest region is still one.
    enough = max(min(min_area, tree.leaf_of_pixel.size), 1)
    is_region = (area >= enough) & ~tree.is_edge
    label_of_root = np.where(is_region, np.cumsum(is_region), BOUNDARY).astype(np.int32)
    return np.asarray(label_of_root[root], dtype=np.int32)
