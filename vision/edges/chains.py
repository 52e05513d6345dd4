"""Linking of edge pixels into chains, and their sub-pixel localisation: the compiled part of ``edges.py``.

The walk runs over flat arrays that have a margin around the image, so that a step is one number and nothing has to
ask for the border.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.geometry.focal_form import norm2
from vision.kernels import njit

Numbers = NDArray[np.int64]

# Cosines between two gradients: of neighbours, of neighbours that need no comparison with others, and across a gap.
_MIN_AGREEMENT, _SAME_DIRECTION, _MIN_AGREEMENT_ACROSS = 0.5, 0.97, 0.85
_MIN_AHEAD = 0.2  # cosine between the tangent and the step to a neighbour
_MAX_TANGENT_ASIDE = 0.62  # tangent of the angle whose cosine is the least one across a gap
_MIN_LENGTH_ACROSS = 4  # only what has some length may reach across a gap; specks of texture may not

_TANGENT_OF_SIXTEENTH = np.tan(np.pi / 8)


@njit(cache=True)
def _sector(tx, ty):
    """Number of the sixteenth of the full turn that a direction lies in, in no particular order."""
    long, short = max(abs(tx), abs(ty)), min(abs(tx), abs(ty))
    return (tx > 0) | (ty > 0) << 1 | (abs(tx) > abs(ty)) << 2 | (short > _TANGENT_OF_SIXTEENTH * long) << 3


def _steps_ahead() -> tuple[Numbers, Numbers]:
    """Steps dx (16, 4) and dy (16, 4) to the four neighbours ahead, by sector, the straightest first."""
    around = np.array([(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dx or dy])
    directions = around / np.linalg.norm(around, axis=1)[:, None]
    steps = np.zeros((16, 4, 2), np.int64)
    for middle in np.arange(16) * np.pi / 8 + np.pi / 16:
        tangent = np.array([np.cos(middle), np.sin(middle)])
        steps[_sector.py_func(*tangent.tolist())] = around[np.argsort(-(directions @ tangent))[:4]]
    return steps[:, :, 0].copy(), steps[:, :, 1].copy()


def link_pixels(
    pixels: NDArray[np.uint8], gx: NDArray[np.int16], gy: NDArray[np.int16], min_length: int, max_gap: int
) -> tuple[Numbers, Numbers]:
    """Link edge pixels into chains.

    Args:
        pixels: (H, W) not 0 on edge pixels.
        gx: (H, W) gradient along x.
        gy: (H, W) gradient along y.
        min_length: chains with fewer pixels are dropped.
        max_gap: gaps up to this length are bridged along the tangent.

    Returns:
        The (N,) numbers y W + x of the pixels in walking order, and the (C + 1,) offsets of the chains.
    """
    margin = max_gap + 1
    sides = (margin, margin, margin, margin)
    free, gx, gy = (np.asarray(cv2.copyMakeBorder(a, *sides, cv2.BORDER_CONSTANT, value=0)) for a in (pixels, gx, gy))
    stride = free.shape[1]
    flags = (free > 0).ravel()
    starts = np.flatnonzero(flags)  # much faster than Numba's
    at, offsets = _link(flags.view(np.int8), starts, gx.ravel(), gy.ravel(), stride, min_length, max_gap)
    # Row by row the margin falls away.
    return at - at // stride * (2 * margin) - margin * (pixels.shape[1] + 1), offsets


_AHEAD_DX, _AHEAD_DY = _steps_ahead()


@njit(cache=True)
def _next_neighbour(free, gx, gy, at, sign, stride):
    """Step (dx, dy) to the free one among the 8 neighbours that continues the walk best, or (0, 0).

    From straight ahead to the sides the first one that has the same gradient; else the one whose cosines between step
    and tangent, and between the gradients, have the largest sum.
    """
    g0x, g0y = float(gx[at]), float(gy[at])
    square0 = g0x * g0x + g0y * g0y
    sector = _sector(-sign * g0y, sign * g0x)
    best, bx, by = 0.0, 0, 0
    for k in range(_AHEAD_DX.shape[1]):
        dx, dy = _AHEAD_DX[sector, k], _AHEAD_DY[sector, k]
        to = at + dy * stride + dx
        if not free[to]:
            continue
        hx, hy = float(gx[to]), float(gy[to])
        agreement, squares = hx * g0x + hy * g0y, square0 * (hx * hx + hy * hy)
        if agreement <= 0 or agreement * agreement < _MIN_AGREEMENT**2 * squares:
            continue
        if best == 0.0 and agreement * agreement >= _SAME_DIRECTION**2 * squares:
            return dx, dy
        ahead = sign * (g0x * dy - g0y * dx) / np.sqrt((dx * dx + dy * dy) * max(square0, 1.0))
        merit = ahead + agreement / np.sqrt(squares)
        if ahead >= _MIN_AHEAD and merit > best:
            best, bx, by = merit, dx, dy
    return bx, by


@njit(cache=True)
def _across_gap(free, gx, gy, at, sign, stride, max_gap):
    """Step (dx, dy) to the free pixel ahead along the tangent, beyond the neighbours, that goes on there; or (0, 0).

    The two ends must agree much better than neighbours need to. Of every ring of pixels around only those are looked
    at that can lie ahead: u counts along the axis that the tangent is closest to, v along the other one, both in the
    sense of the tangent.
    """
    g0x, g0y = float(gx[at]), float(gy[at])
    norm0 = max(norm2(g0x, g0y), 1e-9)
    tx, ty = -sign * g0y / norm0, sign * g0x / norm0
    x_first = abs(tx) >= abs(ty)
    sign_x, sign_y = 1 if tx >= 0 else -1, 1 if ty >= 0 else -1
    best, bx, by = 0.0, 0, 0
    for reach in range(2, max_gap + 2):
        aside = int(_MAX_TANGENT_ASIDE * reach)
        for k in range(-aside, 2 * reach):
            u, v = (reach, k) if k <= reach else (k - reach, reach)
            dx, dy = (sign_x * u, sign_y * v) if x_first else (sign_x * v, sign_y * u)
            to = at + dy * stride + dx
            if not free[to]:
                continue
            ahead = (dx * tx + dy * ty) / np.sqrt(float(dx * dx + dy * dy))
            if ahead < _MIN_AGREEMENT_ACROSS:
                continue
            hx, hy = float(gx[to]), float(gy[to])
            agreement = (hx * g0x + hy * g0y) / (norm0 * max(norm2(hx, hy), 1e-9))
            if agreement >= _MIN_AGREEMENT_ACROSS and ahead + agreement > best:
                best, bx, by = ahead + agreement, dx, dy
        if bx != 0 or by != 0:
            break
    return bx, by


@njit(cache=True)
def _walk(free, gx, gy, at, sign, stride, max_gap, out, count, begin):
    """Follow the edge from a pixel along sign * tangent; append pixel numbers to out, return the new count.

    The chain so far lies in out[begin:count].
    """
    while True:
        dx, dy = _next_neighbour(free, gx, gy, at, sign, stride)
        if dx == 0 and dy == 0 and count - begin >= _MIN_LENGTH_ACROSS:
            dx, dy = _across_gap(free, gx, gy, at, sign, stride, max_gap)
        if dx == 0 and dy == 0:
            return count
        if abs(dx) == 1 and abs(dy) == 1:  # the inner corner of a stair belongs to this step
            free[at + dx] = free[at + dy * stride] = 0
        at += dy * stride + dx
        free[at] = 0
        out[count] = at
        count += 1


@njit(cache=True)
def _link(free, starts, gx, gy, stride, min_length, max_gap):
    """See :func:`link_pixels`; all arrays flat and with a margin. ``free``, not 0 at ``starts``, is used up."""
    order, buffer = np.empty(len(starts), np.int64), np.empty(len(starts), np.int64)
    offsets = [0]
    n = 0
    for start in starts:
        if not free[start]:
            continue
        free[start] = 0
        backward = _walk(free, gx, gy, start, -1.0, stride, max_gap, buffer, 0, 0)
        first = n
        for k in range(backward):
            order[n + k] = buffer[backward - 1 - k]
        n += backward
        order[n] = start
        n = _walk(free, gx, gy, start, 1.0, stride, max_gap, order, n + 1, first)
        if n - first < min_length:
            n = first
            continue
        offsets.append(n)
    return order[:n].copy(), np.array(offsets)


@njit(cache=True)
def _magnitude_at(gx, gy, width, height, x, y):
    """Gradient magnitude at a sub-pixel place, bilinear; the gradients are flat arrays."""
    x0 = min(max(int(np.floor(x)), 0), width - 2)
    y0 = min(max(int(np.floor(y)), 0), height - 2)
    fx, fy = x - x0, y - y0
    at = y0 * width + x0
    upper = (1 - fx) * _magnitude(gx, gy, at) + fx * _magnitude(gx, gy, at + 1)
    at += width
    return (1 - fy) * upper + fy * ((1 - fx) * _magnitude(gx, gy, at) + fx * _magnitude(gx, gy, at + 1))


@njit(cache=True)
def _magnitude(gx, gy, at):
    """Gradient magnitude in a pixel; single precision, whose roots are several times as fast, is enough."""
    a, b = np.float32(gx[at]), np.float32(gy[at])
    return np.sqrt(a * a + b * b)


@njit(cache=True)
def localise(order, gx, gy):
    """Sub-pixel points: the vertex of a parabola through the gradient magnitude along the gradient."""
    height, width = gx.shape
    flat_x, flat_y = gx.ravel(), gy.ravel()
    n, rows_per_pixel = len(order), 1 / width
    points, gradients = np.empty((n, 2)), np.empty((n, 2))
    for k in range(n):
        at = order[k]
        y = int((at + 0.5) * rows_per_pixel)  # the quotient of whole numbers takes several times as long
        x = at - y * width
        a, b = float(flat_x[at]), float(flat_y[at])
        middle = max(norm2(a, b), 1e-9)
        ux, uy = a / middle, b / middle
        before = _magnitude_at(flat_x, flat_y, width, height, x - ux, y - uy)
        after = _magnitude_at(flat_x, flat_y, width, height, x + ux, y + uy)
        bend = before - 2 * middle + after
        shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
        shift = min(max(shift, -0.75), 0.75)
        points[k, 0], points[k, 1] = x + shift * ux, y + shift * uy
        gradients[k, 0], gradients[k, 1] = ux, uy
    return points, gradients
