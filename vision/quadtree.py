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


@dataclass(frozen=True, eq=False)
class _Level:
    """Sums over all blocks of one size, at (row, column) of the block."""

    total: NDArray[np.uint32]
    square_total: NDArray[np.uint32]
    low: NDArray[np.uint8]
    high: NDArray[np.uint8]
    blocked: NDArray[np.bool_]


def split(gray: NDArray[np.uint8], edges: NDArray[np.bool_], settings: SplitAndMerge) -> Quadtree:
    """Split the image until every block is homogeneous: no edge pixel inside, small grey deviation and range.

    Args:
        gray: (H, W) grey levels.
        edges: (H, W) edge map, as linked.
        settings: thresholds.

    Returns:
        The leaves, largest first. Single pixels are always leaves where nothing larger is homogeneous.
    """
    levels = _pyramid(gray, edges, settings.root_size_px)
    shape = levels[-1].total.shape
    leaf_of_block = np.full(shape, -1, np.int32)
    found: list[tuple[NDArray[np.intp], NDArray[np.intp], int]] = []
    count = 0
    for depth in range(len(levels) - 1, -1, -1):
        level = levels[depth]
        is_leaf = leaf_of_block < 0
        if depth:
            is_leaf &= _homogeneous(level, 4**depth, settings)
        else:
            is_leaf[gray.shape[0] :] = is_leaf[:, gray.shape[1] :] = False
        rows, columns = np.nonzero(is_leaf)
        leaf_of_block[rows, columns] = np.arange(count, count + len(rows), dtype=np.int32)
        count += len(rows)
        found.append((rows, columns, depth))
        if depth:
            leaf_of_block = leaf_of_block.repeat(2, axis=0).repeat(2, axis=1)
    return _gather(levels, found, np.ascontiguousarray(leaf_of_block[: gray.shape[0], : gray.shape[1]]))


def _pyramid(gray: NDArray[np.uint8], edges: NDArray[np.bool_], root_size: int) -> list[_Level]:
    """Block sums of all levels, single pixels first; whatever lies outside the image is blocked."""
    height, width = gray.shape
    padding = ((0, -height % root_size), (0, -width % root_size))
    grey = np.pad(gray, padding)
    wide = grey.astype(np.uint32)
    level = _Level(wide, wide * wide, grey, grey, np.pad(edges, padding, constant_values=True))
    levels = [level]
    while level.total.size and len(levels) <= root_size.bit_length() - 1:
        level = _Level(
            _quarters(level.total, np.add),
            _quarters(level.square_total, np.add),
            _quarters(level.low, np.minimum),
            _quarters(level.high, np.maximum),
            _quarters(level.blocked, np.logical_or),
        )
        levels.append(level)
    return levels


def _quarters(a: NDArray, combine: np.ufunc) -> NDArray:
    """Combine the four children of each block."""
    rows = combine(a[::2], a[1::2])
    return np.asarray(combine(rows[:, ::2], rows[:, 1::2]))


def _homogeneous(level: _Level, area: int, settings: SplitAndMerge) -> NDArray[np.bool_]:
    """Blocks without edge pixels whose grey deviation and range stay below the thresholds."""
    mean = level.total / area
    variance = level.square_total / area - mean * mean
    grey_range = level.high - level.low
    small = (variance <= settings.max_deviation**2) & (grey_range <= settings.max_range)
    return np.asarray(small & ~level.blocked)


def _gather(
    levels: list[_Level], found: list[tuple[NDArray[np.intp], NDArray[np.intp], int]], leaf_of_pixel: Labels
) -> Quadtree:
    """The leaves of all levels in one table."""
    return Quadtree(
        leaf_of_pixel=leaf_of_pixel,
        x=np.concatenate([columns << depth for _, columns, depth in found]).astype(np.int32),
        y=np.concatenate([rows << depth for rows, _, depth in found]).astype(np.int32),
        size=np.concatenate([np.full(len(rows), 1 << depth, np.int32) for rows, _, depth in found]),
        is_edge=np.concatenate([levels[depth].blocked[rows, columns] for rows, columns, depth in found]),
        grey_sum=np.concatenate([levels[depth].total[rows, columns] for rows, columns, depth in found]).astype(float),
        grey_square_sum=np.concatenate(
            [levels[depth].square_total[rows, columns] for rows, columns, depth in found]
        ).astype(float),
    )


def merge(tree: Quadtree, settings: SplitAndMerge) -> Labels:
    """Merge neighbouring leaves of similar grey into regions, the most similar pair first.

    Two leaves are neighbours when they share a side (edges are 8-connected, so that sharing a corner would let
    a region slip through a diagonal edge) and neither is an edge pixel. Their regions merge while the means of
    both the leaves and the regions are close. What is left smaller than ``min_area_px`` joins its most similar
    neighbour, if an edge does not enclose it.

    Returns:
        (N,) label of each leaf: ``BOUNDARY``, or 1, 2, ... in the order of the leaves.
    """
    first, second = _neighbour_pairs(tree)
    area = tree.size.astype(float) ** 2
    mean = tree.grey_sum / area
    step = np.abs(mean[first] - mean[second])
    # 1/64 grey level is finer than any threshold, and 16-bit keys sort in linear time.
    order = np.argsort((step * 64).astype(np.uint16), kind="stable")
    root = np.arange(len(tree), dtype=np.int32)
    similar = np.searchsorted(step[order], settings.max_step + 1 / 64)
    _unite(
        root,
        first[order],
        second[order],
        area,
        tree.grey_sum.copy(),
        similar,
        settings.max_contrast,
        settings.min_area_px,
    )
    return _number_regions(tree, root, settings.min_area_px)


def _neighbour_pairs(tree: Quadtree) -> tuple[Labels, Labels]:
    """Pairs of leaves that share a side, neither of them an edge pixel (a pair may be repeated)."""
    leaf = tree.leaf_of_pixel
    free = ~tree.is_edge[leaf]
    firsts, seconds = [], []
    for a, b, open_side in (
        (leaf[:, :-1], leaf[:, 1:], free[:, :-1] & free[:, 1:]),
        (leaf[:-1], leaf[1:], free[:-1] & free[1:]),
    ):
        apart = (a != b) & open_side
        firsts.append(a[apart])
        seconds.append(b[apart])
    return np.concatenate(firsts), np.concatenate(seconds)


@njit(cache=True)
def _find(root, i):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Root of a leaf, halving the path on the way."""
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@njit(cache=True)
def _unite(root, first, second, area, total, similar, max_contrast, min_area):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Union-find over the pairs in order: the first ``similar`` ones by contrast, then all by lack of area."""
    area = area.copy()
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


def _number_regions(tree: Quadtree, root: Labels, min_area: int) -> Labels:
    """Consecutive labels for the regions that are large enough."""
    area = np.bincount(root, weights=tree.size.astype(float) ** 2, minlength=len(root))
    # An image smaller than the smallest region is still one.
    enough = max(min(min_area, tree.leaf_of_pixel.size), 1)
    is_region = (area >= enough) & ~tree.is_edge
    label_of_root = np.where(is_region, np.cumsum(is_region), BOUNDARY).astype(np.int32)
    return np.asarray(label_of_root[root], dtype=np.int32)
