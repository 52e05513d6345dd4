"""Contours of all regions of a label image in one pass: border following after Suzuki and Abe (1985)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

_STEPS = np.array([[1, 0], [1, -1], [0, -1], [-1, -1], [-1, 0], [-1, 1], [0, 1], [1, 1]])
"""(x, y) of the eight neighbours, counter-clockwise as seen on the screen, from the one to the right."""

_SEEN, _SEEN_WITH_RIGHT_SIDE = 1, -1


@dataclass(frozen=True, eq=False)
class Contours:
    """The boundary pixels of regions.

    Attributes:
        points: (M, 2) int32 pixels (x, y), one contour after the other.
        ends: (K + 1,) where contour k lies: ``points[ends[k]:ends[k + 1]]``.
        labels: (K,) the region that each contour bounds.
        is_hole: (K,) whether it is an inner boundary.
    """

    points: NDArray[np.int32]
    ends: NDArray[np.int64]
    labels: NDArray[np.int32]
    is_hole: NDArray[np.bool_]


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
def _trace(labels, wanted):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The arrays of :class:`Contours`."""
    height, width = labels.shape
    # With a margin that no region has, and in one row: neighbours are then found by one addition, unchecked.
    stride = width + 2
    padded = np.full((height + 2, stride), -1, labels.dtype)
    padded[1:-1, 1:-1] = labels
    flat = padded.ravel()
    marks = np.zeros(len(flat), np.int8)
    steps = _STEPS[:, 1] * stride + _STEPS[:, 0]
    chain = np.empty(4096, np.int64)
    ends, of_region, is_hole = [0], [labels[0, 0]], [False]
    for y in range(1, height + 1):
        for i in range(y * stride + 1, y * stride + 1 + width):
            label = flat[i]
            starts_outer, starts_hole = flat[i - 1] != label, flat[i + 1] != label
            if not (starts_outer or starts_hole) or not wanted[label]:
                continue
            starts_outer &= marks[i] == 0
            if starts_outer or (starts_hole and marks[i] >= 0):
                chain, end = _follow(flat, marks, steps, i, not starts_outer, chain, ends[-1])
                ends.append(end)
                of_region.append(label)
                is_hole.append(not starts_outer)
    points = np.empty((ends[-1], 2), np.int32)
    for k in range(ends[-1]):
        points[k, 0], points[k, 1] = chain[k] % stride - 1, chain[k] // stride - 1
    # The lists begin with a dummy, for Numba asks for the type of their elements.
    return points, np.array(ends), np.array(of_region)[1:], np.array(is_hole)[1:]


@njit(cache=True)
def _follow(flat, marks, steps, first, is_hole, chain, n):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Follow one contour from its first pixel, from place ``n`` on in ``chain``: this, or a longer one, and the end."""
    label = flat[first]
    stop = direction = 0 if is_hole else 4
    while True:
        direction = (direction - 1) & 7
        last = first + steps[direction]
        alone = flat[last] != label
        if not alone or direction == stop:
            break
    at = first
    while True:
        if n == len(chain):
            chain = np.concatenate((chain, np.empty_like(chain)))
        chain[n] = at
        n += 1
        if alone:
            marks[first] = _SEEN_WITH_RIGHT_SIDE
            return chain, n
        while True:
            direction += 1
            after = at + steps[direction & 7]
            if flat[after] == label:
                break
        if direction > 8:  # passed the neighbour to the right, which is none of the region's
            marks[at] = _SEEN_WITH_RIGHT_SIDE
        elif marks[at] == 0:
            marks[at] = _SEEN
        if after == first and at == last:
            return chain, n
        at = after
        direction = (direction + 4) & 7
