"""The split of split and merge (Section 5.1): a quadtree of homogeneous blocks without edge pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.kernels import njit
from vision.settings import NOT_NEGATIVE, check, count

Labels = NDArray[np.int32]


@dataclass(frozen=True)
class SplitAndMergeParameters:
    """What counts as homogeneous and as similar, in grey levels.

    Attributes:
        max_deviation: largest standard deviation of the grey level within a homogeneous block.
        max_range: largest difference of two grey levels within a homogeneous block.
        max_step: largest difference of the means of two neighbouring blocks that may be merged.
        max_contrast: largest difference of the means of two regions that may be merged.
        min_area_px: smaller regions go to the most similar neighbour that no edge separates them from.
        root_size_px: side of the largest blocks; a power of two, at most 256.
    """

    max_deviation: float = 6.0
    max_range: float = 32.0
    max_step: float = 16.0
    max_contrast: float = 40.0
    min_area_px: int = 32
    root_size_px: int = 64

    def __post_init__(self) -> None:
        check(self, max_deviation=NOT_NEGATIVE, max_range=NOT_NEGATIVE, max_step=NOT_NEGATIVE)
        check(self, max_contrast=NOT_NEGATIVE, min_area_px=count(), root_size_px=count(1))
        # Sums over larger blocks would not fit into 32 bits.
        if not 1 <= self.root_size_px <= 256 or self.root_size_px & (self.root_size_px - 1):
            raise InputError("root_size_px", got=self.root_size_px, expected="a power of two, at most 256")


@dataclass(frozen=True, eq=False)
@frozen_arrays
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

    def __len__(self) -> int:
        return len(self.x)


def split(gray: NDArray[np.uint8], edges: NDArray[np.bool_], parameters: SplitAndMergeParameters) -> Quadtree:
    """Split the image until every block is homogeneous: no edge pixel inside, small grey deviation and range.

    Args:
        gray: (H, W) grey levels.
        edges: (H, W) edge map, as linked.
        parameters: thresholds.

    Returns:
        The leaves, largest first. Single pixels are always leaves where nothing larger is homogeneous.
    """
    leaf_of_pixel, *of_leaf = _split(
        np.ascontiguousarray(gray),
        np.ascontiguousarray(edges),
        parameters.root_size_px.bit_length() - 1,
        float(parameters.max_deviation**2),
        float(parameters.max_range),
    )
    return Quadtree(leaf_of_pixel, *of_leaf)


@njit(cache=True)
def _split(gray, edges, depth, max_variance, max_range):
    """The arrays of the :class:`Quadtree` whose largest blocks have the side 2 ** ``depth``."""
    height, width = gray.shape
    leaf_of_pixel = np.full((height, width), -1, np.int32)
    # Blocks that reach over the image are never whole, so that only those inside need to be looked at.
    levels = [_quarter_pixels(gray, edges)]
    for _ in range(1, depth):
        levels.append(_quarter(levels[-1]))
    found, n = [], 0
    for level in range(depth, 0, -1):
        found.append(_uncovered(leaf_of_pixel, levels[level - 1], 1 << level, max_variance, max_range))
        n = _cover(leaf_of_pixel, found[-1], levels[level - 1].shape[1], 1 << level, n)
    found.append(_negative(leaf_of_pixel.ravel()))
    n = _cover(leaf_of_pixel, found[-1], width, 1, n)
    # In arrays of just this length: fresh memory costs more than what is written to it.
    x, y, size = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    is_edge, total, square_total = np.zeros(n, np.bool_), np.empty(n), np.empty(n)
    n = 0
    for level in range(depth, 0, -1):
        side, blocks = 1 << level, levels[level - 1]
        for block in found[depth - level]:
            row, column = block // blocks.shape[1], block % blocks.shape[1]
            x[n], y[n], size[n] = column * side, row * side, side
            total[n], square_total[n] = blocks[row, column, 0], blocks[row, column, 1]
            n += 1
    for pixel in found[depth]:
        row, column = pixel // width, pixel % width
        grey = float(gray[row, column])
        x[n], y[n], size[n], total[n], square_total[n] = column, row, 1, grey, grey * grey
        is_edge[n] = edges[row, column]
        n += 1
    return leaf_of_pixel, x, y, size, is_edge, total, square_total


@njit(cache=True)
def _uncovered(leaf_of_pixel, blocks, side, max_variance, max_range):
    """Numbers of the homogeneous blocks of one size that lie in no leaf yet, row by row."""
    found = np.empty(blocks.shape[0] * blocks.shape[1] + 1, np.int32)
    n = 0
    for row in range(blocks.shape[0]):
        for column in range(blocks.shape[1]):
            mean = blocks[row, column, 0] / (side * side)
            variance = blocks[row, column, 1] / (side * side) - mean * mean
            is_narrow = blocks[row, column, 3] - blocks[row, column, 2] <= max_range
            # Always written, counted only where it holds: a branch here would be mispredicted.
            found[n] = row * blocks.shape[1] + column
            n += is_narrow & (variance <= max_variance) & (leaf_of_pixel[row * side, column * side] < 0)
    return found[:n]


@njit(cache=True)
def _negative(numbers):
    """Where numbers (N,) are below 0."""
    found = np.empty(len(numbers) + 1, np.int32)
    n = 0
    for i in range(len(numbers)):
        found[n] = i
        n += numbers[i] < 0
    return found[:n]


@njit(cache=True)
def _cover(leaf_of_pixel, blocks, columns, side, n):
    """Number the pixels of blocks, ``columns`` of which lie in a row, from leaf ``n`` on; the number after these."""
    for block in blocks:
        top, left = block // columns * side, block % columns * side
        for y in range(top, top + side):
            for x in range(left, left + side):
                leaf_of_pixel[y, x] = n
        n += 1
    return n


@njit(cache=True)
def _quarter_pixels(gray, edges):
    """(H // 2, W // 2, 4) sum, sum of squares, least and greatest grey of blocks of four pixels.

    A block with an edge pixel has the greatest grey 2 ** 30, so that no such block is homogeneous.
    """
    blocks = np.empty((gray.shape[0] // 2, gray.shape[1] // 2, 4), np.uint32)
    for row in range(blocks.shape[0]):
        for column in range(blocks.shape[1]):
            v, u = 2 * row, 2 * column
            a, b, c, d = int(gray[v, u]), int(gray[v, u + 1]), int(gray[v + 1, u]), int(gray[v + 1, u + 1])
            blocked = edges[v, u] | edges[v, u + 1] | edges[v + 1, u] | edges[v + 1, u + 1]
            blocks[row, column, 0] = a + b + c + d
            blocks[row, column, 1] = a * a + b * b + c * c + d * d
            blocks[row, column, 2] = min(min(a, b), min(c, d))
            blocks[row, column, 3] = 2**30 if blocked else max(max(a, b), max(c, d))
    return blocks


@njit(cache=True)
def _quarter(blocks):
    """The same over four blocks each."""
    quarters = np.empty((blocks.shape[0] // 2, blocks.shape[1] // 2, 4), blocks.dtype)
    for row in range(quarters.shape[0]):
        for column in range(quarters.shape[1]):
            v, u = 2 * row, 2 * column
            for k in range(4):
                a, b, c, d = blocks[v, u, k], blocks[v, u + 1, k], blocks[v + 1, u, k], blocks[v + 1, u + 1, k]
                if k < 2:
                    quarters[row, column, k] = a + b + c + d
                elif k == 2:
                    quarters[row, column, k] = min(min(a, b), min(c, d))
                else:
                    quarters[row, column, k] = max(max(a, b), max(c, d))
    return quarters
