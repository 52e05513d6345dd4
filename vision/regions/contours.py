"""Contours of all regions of a label image in one pass: border following after Suzuki and Abe (1985)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays
from vision.kernels import njit

_STEPS = np.array([[1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1], [0, 1], [1, 1]])
"""(x, y) of the eight neighbours, counter-clockwise as seen on the screen, from the one to the right."""

_SEEN, _SEEN_WITH_RIGHT_SIDE = 1, -1


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Contours:
    """The boundary pixels of regions.

    Attributes:
        points: (M, 2) int32 pixels (x, y), one contour after the other.
        ends: (K + 1,) where contour k lies: ``points[ends[k]:ends[k + 1]]``.
        labels: (K,) the region that each contour bounds.
    """

    points: NDArray[np.int32]
    ends: NDArray[np.int64]
    labels: NDArray[np.int32]


def trace_contours(labels: NDArray[np.int32], wanted: NDArray[np.bool_]) -> Contours:
    """The contours of 8-connected regions, each as ``cv2.findContours`` gives it for the mask of the region.

    Args:
        labels: (H, W) the label of each pixel, 0 or more.
        wanted: (largest label + 1,) the labels whose contours are asked for.

    Returns:
        The contours in the order in which their first pixels come in the image, so that the outer boundary of a
        region comes before its holes.
    """
    return Contours(*_trace(labels, wanted))


@njit(cache=True)
def _trace(labels, wanted):
    """The arrays of :class:`Contours`."""
    height, width = labels.shape
    marks = np.zeros(labels.shape, np.int8)
    chain = np.empty((4096, 2), np.int32)
    ends, of_region = [0], [labels[0, 0]]
    for y in range(height):
        for x in range(width):
            label = labels[y, x]
            starts_outer = x == 0 or labels[y, x - 1] != label
            starts_hole = x == width - 1 or labels[y, x + 1] != label
            if not (starts_outer or starts_hole) or not wanted[label]:
                continue
            starts_outer &= marks[y, x] == 0
            if starts_outer or (starts_hole and marks[y, x] >= 0):
                chain, end = _follow(labels, marks, x, y, not starts_outer, chain, ends[-1])
                ends.append(end)
                of_region.append(label)
    # The second list begins with a dummy, for Numba asks for the type of its elements.
    return chain[: ends[-1]].copy(), np.array(ends), np.array(of_region)[1:]


@njit(cache=True)
def _follow(labels, marks, x, y, is_hole, chain, n):
    """Follow one contour from its first pixel into ``chain``, at ``n``: this, or a longer one, and the end."""
    label = labels[y, x]
    stop = direction = 0 if is_hole else 4
    while True:
        direction = (direction - 1) & 7
        last_x, last_y = x + _STEPS[direction, 0], y + _STEPS[direction, 1]
        alone = not _is(labels, last_x, last_y, label)
        if not alone or direction == stop:
            break
    at_x, at_y = x, y
    while True:
        if n == len(chain):
            chain = np.concatenate((chain, np.empty_like(chain)))
        chain[n, 0], chain[n, 1] = at_x, at_y
        n += 1
        if alone:
            marks[y, x] = _SEEN_WITH_RIGHT_SIDE
            return chain, n
        while True:
            direction += 1
            next_x, next_y = at_x + _STEPS[direction & 7, 0], at_y + _STEPS[direction & 7, 1]
            if _is(labels, next_x, next_y, label):
                break
        if direction > 8:  # passed the neighbour to the right, which is none of the region's
            marks[at_y, at_x] = _SEEN_WITH_RIGHT_SIDE
        elif marks[at_y, at_x] == 0:
            marks[at_y, at_x] = _SEEN
        if next_x == x and next_y == y and at_x == last_x and at_y == last_y:
            return chain, n
        at_x, at_y = next_x, next_y
        direction = (direction + 4) & 7


@njit(cache=True)
def _is(labels, x, y, label):
    """Whether a pixel lies in the image and has this label."""
    return 0 <= x < labels.shape[1] and 0 <= y < labels.shape[0] and labels[y, x] == label
