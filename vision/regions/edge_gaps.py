"""Edge linking on a binary edge map (Section 5.1): extends loose chain ends until they meet another edge.

Non-maximum suppression breaks contours where three surfaces meet: at a T-junction the gradient of the stem is
swamped by that of the bar, so that the stem stops a few pixels short. Regions would leak through these gaps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.kernels import njit

TANGENT_LENGTH_PX = 8
"""Length of chain behind an end that gives its direction."""

MIN_CHAIN_PX = 4
"""Shorter chains have no direction worth following."""

_TURNS_RAD = np.radians([0.0, 12.0, -12.0, 24.0, -24.0, 36.0, -36.0])


def link_edges(edges: NDArray[np.bool_], gap_px: int = 3) -> NDArray[np.bool_]:
    """Close gaps of an edge map at chain ends and T-junctions.

    Every end of a chain is extended along its tangent, or up to 36 degrees beside it, until it meets an edge that
    does not belong to the stretch of chain it comes from, or the image border. Ends that meet nothing within
    ``gap_px`` stay as they are.

    Args:
        edges: (H, W) thin edge map.
        gap_px: longest gap that is closed, in pixels; 0 closes none.

    Returns:
        (H, W) a new map: all edge pixels given and the pixels that close the gaps.

    Raises:
        InputError: when the map is not two-dimensional or the gap is negative.
    """
    if np.ndim(edges) != 2:
        raise InputError("edge map", got=f"shape {np.shape(edges)}", expected="(H, W)")
    if gap_px < 0:
        raise InputError("gap_px", got=gap_px, expected=">= 0")
    given = np.ascontiguousarray(edges, dtype=np.bool_)
    linked = given.copy()
    if gap_px and given.any():
        _extend_ends(given, linked, int(gap_px), _TURNS_RAD)
    return linked


@njit(cache=True)
def _neighbours(edges, x, y, out):
    """Write the edges among the 8 neighbours of a pixel to ``out`` (8, 2), those sharing a side first; count them."""
    height, width = edges.shape
    n = 0
    for diagonal in (0, 1):
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                if abs(dx) + abs(dy) != 1 + diagonal:
                    continue
                u, v = x + dx, y + dy
                if 0 <= u < width and 0 <= v < height and edges[v, u]:
                    out[n, 0], out[n, 1] = u, v
                    n += 1
    return n


@njit(cache=True)
def _is_end(around, n):
    """Whether a pixel with these neighbours ends a chain: one neighbour, or two that touch (the tip of a stair)."""
    if n == 1:
        return True
    return n == 2 and abs(around[0, 0] - around[1, 0]) + abs(around[0, 1] - around[1, 1]) == 1


@njit(cache=True)
def _walk_back(edges, x, y, chain, around):
    """Follow the chain from its end at (x, y) into ``chain`` (N, 2); the number of pixels found."""
    chain[0, 0], chain[0, 1] = x, y
    length = 1
    while length < len(chain):
        n = _neighbours(edges, chain[length - 1, 0], chain[length - 1, 1], around)
        step = -1
        for i in range(n):
            fresh = True
            for k in range(max(0, length - 4), length):
                fresh = fresh and not (chain[k, 0] == around[i, 0] and chain[k, 1] == around[i, 1])
            if fresh:
                step = i
                break
        if step < 0:
            break
        chain[length] = around[step]
        length += 1
    return length


@njit(cache=True)
def _reach(edges, chain, length, angle, gap_px):
    """Steps from the chain's end along a direction until another edge or the border is touched; 0 for never."""
    height, width = edges.shape
    cos, sin = np.cos(angle), np.sin(angle)
    for step in range(1, gap_px + 2):
        x, y = int(np.round(chain[0, 0] + step * cos)), int(np.round(chain[0, 1] + step * sin))
        if not (0 <= x < width and 0 <= y < height):
            return step
        if edges[y, x]:
            for k in range(length):
                if chain[k, 0] == x and chain[k, 1] == y:
                    return 0
            return step
    return 0


@njit(cache=True)
def _extend_ends(edges, linked, gap_px, turns):
    """Extend every chain end of ``edges``, drawing into ``linked``; the straightest short way wins."""
    height, width = edges.shape
    around = np.empty((8, 2), np.int64)
    chain = np.empty((TANGENT_LENGTH_PX, 2), np.int64)
    for y in range(height):
        for x in range(width):
            if not edges[y, x] or not _is_end(around, _neighbours(edges, x, y, around)):
                continue
            length = _walk_back(edges, x, y, chain, around)
            if length < MIN_CHAIN_PX:
                continue
            tangent = np.arctan2(float(y - chain[length - 1, 1]), float(x - chain[length - 1, 0]))
            best_angle, best_steps, best_cost = 0.0, 0, np.inf
            for turn in turns:
                steps = _reach(edges, chain, length, tangent + turn, gap_px)
                cost = steps * (1.0 + abs(turn))
                if steps and cost < best_cost:
                    best_angle, best_steps, best_cost = tangent + turn, steps, cost
            for step in range(1, best_steps):
                u, v = x + step * np.cos(best_angle), y + step * np.sin(best_angle)
                linked[int(np.round(v)), int(np.round(u))] = True
