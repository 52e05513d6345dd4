"""Linking of edge pixels into chains, and their sub-pixel localisation: the compiled part of ``edges.py``."""

from __future__ import annotations

import numpy as np
from numba import njit

# Cosines between the tangent and the step to a neighbour, between two gradients, and of both across a gap.
_MIN_AHEAD, _MIN_AGREEMENT, _MIN_AGREEMENT_ACROSS = 0.2, 0.5, 0.85


@njit(cache=True)
def _next_neighbour(free, gx, gy, x, y, sign):  # type: ignore[no-untyped-def]
    """The free one among the 8 neighbours that continues the walk from (x, y) best, or (-1, -1).

    Roots and quotients are only taken where two neighbours compete.
    """
    height, width = free.shape
    g0x, g0y = float(gx[y, x]), float(gy[y, x])
    square0 = g0x * g0x + g0y * g0y
    best, bx, by = 0.0, -1, -1
    for dy in range(-1 if y > 0 else 0, 2 if y < height - 1 else 1):
        for dx in range(-1 if x > 0 else 0, 2 if x < width - 1 else 1):
            if not free[y + dy, x + dx]:
                continue
            ahead = sign * (g0x * dy - g0y * dx)
            square = float(dx * dx + dy * dy)
            if ahead <= 0 or ahead * ahead < _MIN_AHEAD**2 * square * square0:
                continue
            hx, hy = float(gx[y + dy, x + dx]), float(gy[y + dy, x + dx])
            agreement, square_h = hx * g0x + hy * g0y, hx * hx + hy * hy
            if agreement <= 0 or agreement * agreement < _MIN_AGREEMENT**2 * square0 * square_h:
                continue
            if bx >= 0:
                if best == 0.0:
                    best = _merit(gx, gy, x, y, bx - x, by - y, sign)
                merit = _merit(gx, gy, x, y, dx, dy, sign)
                if merit <= best:
                    continue
                best = merit
            bx, by = x + dx, y + dy
    return bx, by


@njit(cache=True)
def _merit(gx, gy, x, y, dx, dy, sign):  # type: ignore[no-untyped-def]
    """Cosine between tangent and step, plus cosine between the two gradients."""
    g0x, g0y, hx, hy = float(gx[y, x]), float(gy[y, x]), float(gx[y + dy, x + dx]), float(gy[y + dy, x + dx])
    square0 = g0x * g0x + g0y * g0y
    ahead = sign * (g0x * dy - g0y * dx) / np.sqrt(float(dx * dx + dy * dy) * square0)
    return ahead + (hx * g0x + hy * g0y) / np.sqrt(square0 * (hx * hx + hy * hy))


@njit(cache=True)
def _across_gap(free, gx, gy, x, y, sign, max_gap):  # type: ignore[no-untyped-def]
    """The free pixel ahead along the tangent at (x, y), beyond its neighbours, that goes on there; or (-1, -1).

    The two ends must agree much better than neighbours need to.
    """
    height, width = free.shape
    g0x, g0y = float(gx[y, x]), float(gy[y, x])
    norm0 = max(np.sqrt(g0x * g0x + g0y * g0y), 1e-9)
    tx, ty = -sign * g0y / norm0, sign * g0x / norm0
    best, bx, by = 0.0, -1, -1
    for reach in range(2, max_gap + 2):
        for dy in range(max(-reach, -y), min(reach, height - 1 - y) + 1):
            for dx in range(-reach, reach + 1, 1 if abs(dy) == reach else 2 * reach):
                if x + dx < 0 or x + dx >= width or not free[y + dy, x + dx]:
                    continue
                ahead = (dx * tx + dy * ty) / np.sqrt(float(dx * dx + dy * dy))
                if ahead < _MIN_AGREEMENT_ACROSS:
                    continue
                hx, hy = float(gx[y + dy, x + dx]), float(gy[y + dy, x + dx])
                agreement = (hx * g0x + hy * g0y) / (norm0 * max(np.sqrt(hx * hx + hy * hy), 1e-9))
                if agreement >= _MIN_AGREEMENT_ACROSS and ahead + agreement > best:
                    best, bx, by = ahead + agreement, x + dx, y + dy
        if bx >= 0:
            break
    return bx, by


@njit(cache=True)
def _walk(free, gx, gy, x, y, sign, max_gap, out, count, begin):  # type: ignore[no-untyped-def]
    """Follow the edge from (x, y) along sign * tangent; append pixel numbers to out, return the new count.

    The chain so far lies in out[begin:count].
    """
    width = free.shape[1]
    while True:
        nx, ny = _next_neighbour(free, gx, gy, x, y, sign)
        # Only what has some length may reach across a gap; specks of texture may not.
        if nx < 0 and count - begin >= 4:
            nx, ny = _across_gap(free, gx, gy, x, y, sign, max_gap)
        if nx < 0:
            return count
        if abs(nx - x) == 1 and abs(ny - y) == 1:  # the inner corner of a stair belongs to this step
            free[y, nx] = free[ny, x] = False
        x, y = nx, ny
        free[y, x] = False
        out[count] = y * width + x
        count += 1


@njit(cache=True)
def link_pixels(pixels, gx, gy, min_length, max_gap):  # type: ignore[no-untyped-def]
    """Link edge pixels into chains: pixel numbers in walking order, chain offsets, closed flags."""
    width = pixels.shape[1]
    free = pixels > 0
    starts = np.flatnonzero(free)
    total = len(starts)
    order = np.empty(total, np.int64)
    buffer = np.empty(total, np.int64)
    offsets = [0]
    closed = [False]
    n = 0
    for start in starts:
        y, x = start // width, start % width
        if not free[y, x]:
            continue
        free[y, x] = False
        backward = _walk(free, gx, gy, x, y, -1.0, max_gap, buffer, 0, 0)
        first = n
        for k in range(backward):
            order[n + k] = buffer[backward - 1 - k]
        n += backward
        order[n] = start
        n = _walk(free, gx, gy, x, y, 1.0, max_gap, order, n + 1, first)
        if n - first < min_length:
            n = first
            continue
        head, tail = order[first], order[n - 1]
        gap = max(abs(head // width - tail // width), abs(head % width - tail % width))
        offsets.append(n)
        closed.append(gap <= max_gap + 1 and n - first >= 16)
    return order[:n].copy(), np.array(offsets), np.array(closed)[1:]


@njit(cache=True)
def _magnitude_at(gx, gy, x, y):  # type: ignore[no-untyped-def]
    """Gradient magnitude at a sub-pixel place, bilinear."""
    height, width = gx.shape
    x0 = min(max(int(np.floor(x)), 0), width - 2)
    y0 = min(max(int(np.floor(y)), 0), height - 2)
    fx, fy = x - x0, y - y0
    value = 0.0
    for dy in range(2):
        for dx in range(2):
            weight = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
            a, b = float(gx[y0 + dy, x0 + dx]), float(gy[y0 + dy, x0 + dx])
            value += weight * np.sqrt(a * a + b * b)
    return value


@njit(cache=True)
def localise(order, gx, gy):  # type: ignore[no-untyped-def]
    """Sub-pixel points: the vertex of a parabola through the gradient magnitude along the gradient."""
    width = gx.shape[1]
    n = len(order)
    points, gradients, magnitudes = np.empty((n, 2)), np.empty((n, 2)), np.empty(n)
    for k in range(n):
        y, x = order[k] // width, order[k] % width
        a, b = float(gx[y, x]), float(gy[y, x])
        middle = max(np.sqrt(a * a + b * b), 1e-9)
        ux, uy = a / middle, b / middle
        before = _magnitude_at(gx, gy, x - ux, y - uy)
        after = _magnitude_at(gx, gy, x + ux, y + uy)
        bend = before - 2 * middle + after
        shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
        shift = min(max(shift, -0.75), 0.75)
        points[k, 0], points[k, 1] = x + shift * ux, y + shift * uy
        gradients[k, 0], gradients[k, 1] = ux, uy
        magnitudes[k] = middle
    return points, gradients, magnitudes
