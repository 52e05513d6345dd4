"""The merge of split and merge (Section 5.1): leaves of a quadtree grow into regions."""

from __future__ import annotations

import numpy as np

from vision.kernels import njit
from vision.regions.quadtree import Labels, Quadtree, SplitAndMergeParameters

BOUNDARY = 0
"""Label of the pixels that belong to no region: edge pixels, and specks too small to be regions."""

_STEPS_PER_LEVEL = 64
"""Steps between grey levels are told apart to 1 / 64, finer than any threshold, so that sorting is counting."""


def merge(tree: Quadtree, parameters: SplitAndMergeParameters) -> Labels:
    """Merge neighbouring leaves of similar grey into regions, the most similar pair first.

    Two leaves are neighbours when they share a side (edges are 8-connected, so that sharing a corner would let
    a region slip through a diagonal edge) and neither is an edge pixel. Their regions merge while the means of
    both the leaves and the regions are close. What is left smaller than ``min_area_px`` joins its most similar
    neighbour, if an edge does not enclose it.

    Returns:
        (N,) label of each leaf: ``BOUNDARY``, or 1, 2, ... in the order of the leaves.
    """
    labels: Labels = _merge(
        tree.leaf_of_pixel,
        tree.size,
        tree.is_edge,
        tree.grey_sum,
        float(parameters.max_step),
        float(parameters.max_contrast),
        float(parameters.min_area_px),
    )
    return labels


@njit(cache=True)
def _merge(leaf, size, is_edge, grey_sum, max_step, max_contrast, min_area):
    """The labels (N,) of :func:`merge`."""
    area, mean = np.empty(len(size), np.int32), np.empty(len(size))
    for i in range(len(size)):
        area[i] = size[i] * size[i]
        mean[i] = np.nan if is_edge[i] else grey_sum[i] / area[i]
    pairs, similar = _neighbour_pairs(leaf, mean, max_step)
    root = np.arange(len(size)).astype(np.int32)
    total = mean  # no longer needed, and memory that is at hand
    total[:] = grey_sum
    _unite(root, pairs, similar, area, total, max_contrast, min_area)
    # An image smaller than the smallest region is still one.
    enough = max(min(min_area, leaf.size), 1)
    labels = np.zeros(len(root), np.int32)
    count = 0
    for i in range(len(root)):
        if root[i] == i and area[i] >= enough and not is_edge[i]:
            count += 1
            labels[i] = count
    for i in range(len(root)):
        labels[i] = labels[root[i]]
    return labels


@njit(cache=True)
def _neighbour_pairs(leaf, mean, max_step):
    """Pairs (M, 2) of leaves that share a side, by the step between their means, and how many have a small step.

    A pair is repeated for each pixel of the side. Leaves whose mean is NaN have no neighbours. Equal steps stay in
    the order of the image.
    """
    first, second = _sides(leaf.ravel(), leaf.shape[1])
    after = np.zeros(256 * _STEPS_PER_LEVEL + 1, np.int32)
    keys = np.empty(len(first), np.int16)
    for k in range(len(first)):
        step = abs(mean[first[k]] - mean[second[k]])
        keys[k] = int(step * _STEPS_PER_LEVEL) if step >= 0 else -1
        after[keys[k] + 1] += 1
    after[0] = 0  # those with edge pixels
    for key in range(1, len(after)):
        after[key] += after[key - 1]
    similar = after[min(int(max_step * _STEPS_PER_LEVEL) + 1, len(after) - 1)]
    pairs = np.empty((after[-1], 2), np.int32)
    for k in range(len(first)):
        if keys[k] >= 0:
            place = after[keys[k]]
            pairs[place, 0], pairs[place, 1] = first[k], second[k]
            after[keys[k]] += 1
    return pairs, similar


@njit(cache=True)
def _sides(flat, width):
    """Different leaves of neighbouring pixels: first of all that lie side by side, then one below the other."""
    first, second = np.empty(2 * len(flat) + 1, np.int32), np.empty(2 * len(flat) + 1, np.int32)
    n = 0
    # Always written, counted only where it holds: a branch here would be mispredicted.
    for row in range(0, len(flat), width):
        for i in range(row, row + width - 1):
            first[n], second[n] = flat[i], flat[i + 1]
            n += flat[i] != flat[i + 1]
    for i in range(len(flat) - width):
        first[n], second[n] = flat[i], flat[i + width]
        n += flat[i] != flat[i + width]
    return first[:n], second[:n]


@njit(cache=True)
def _find(root, i):
    """Root of a leaf, halving the path on the way."""
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


@njit(cache=True)
def _unite(root, pairs, similar, area, total, max_contrast, min_area):
    """Union-find over the pairs in order: the first ``similar`` ones by contrast, then all by lack of area.

    ``root`` (N,) becomes the root of each leaf, ``area`` and ``total`` at the roots become those of the regions.
    Overwrites ``pairs``.
    """
    apart = 0
    for k in range(len(pairs)):
        a, b = _find(root, pairs[k, 0]), _find(root, pairs[k, 1])
        if a == b:
            continue
        if k < similar and abs(total[a] / area[a] - total[b] / area[b]) <= max_contrast:
            _join(root, area, total, a, b)
        else:  # again below: most pairs have no need to
            pairs[apart, 0], pairs[apart, 1] = pairs[k, 0], pairs[k, 1]
            apart += 1
    for k in range(apart):
        a, b = _find(root, pairs[k, 0]), _find(root, pairs[k, 1])
        if a != b and min(area[a], area[b]) < min_area:
            _join(root, area, total, a, b)
    for i in range(len(root)):
        root[i] = _find(root, i)


@njit(cache=True)
def _join(root, area, total, a, b):
    """Make the larger of two regions the root of the other."""
    if area[a] < area[b]:
        a, b = b, a
    root[b] = a
    area[a] += area[b]
    total[a] += total[b]
