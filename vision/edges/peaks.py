"""Where exactly an edge is: the gradient read across it, between the pixels, and the peak of what is read.

Close to its peak, the gradient of a blurred step is a Gaussian, so its logarithm is a parabola: three samples, one
pixel apart, give the peak. Linear interpolation would flatten the samples that lie between pixels, and with them draw
the peaks of all edges of one direction to the same side.
"""

from __future__ import annotations

import numpy as np

from vision.kernels import njit

MAX_SHIFT_PX = 0.75


@njit(cache=True)
def settle(points, gradients, gx, gy):
    """Edge points (N, 2) moved along their unit gradients (N, 2) onto the peak of the gradient gx, gy (H, W)."""
    settled = points.copy()
    for i in range(len(points)):
        x, y, ux, uy = points[i, 0], points[i, 1], gradients[i, 0], gradients[i, 1]
        here = slope_across(x, y, ux, uy, gx, gy)
        before = slope_across(x - ux, y - uy, ux, uy, gx, gy)
        after = slope_across(x + ux, y + uy, ux, uy, gx, gy)
        if before < here > after:
            shift = log_peak(before, here, after)
            if abs(shift) < MAX_SHIFT_PX:
                settled[i, 0], settled[i, 1] = x + shift * ux, y + shift * uy
    return settled


@njit(cache=True)
def log_peak(before, here, after):
    """Where the peak is, in steps from the middle one of three samples of a Gaussian."""
    a, b, c = np.log(max(before, 1.0)), np.log(max(here, 1.0)), np.log(max(after, 1.0))
    return (c - a) / (2 * max(2 * b - a - c, 1e-9))


@njit(cache=True)
def slope_across(x, y, nx, ny, gx, gy):
    """Size of the gradient gx, gy (H, W) along the normal at (x, y), by cubic interpolation; 0 at the border."""
    height, width = gx.shape
    left, top = int(np.floor(x)) - 1, int(np.floor(y)) - 1
    if left < 0 or top < 0 or left + 3 >= width or top + 3 >= height:
        return 0.0
    by_x, by_y = _cubic_weights(x - left - 1), _cubic_weights(y - top - 1)
    value = 0.0
    for v in range(4):
        for u in range(4):
            across = gx[top + v, left + u] * nx + gy[top + v, left + u] * ny
            value += by_y[v] * by_x[u] * across
    return abs(value)


@njit(cache=True)
def _cubic_weights(t):
    """Catmull-Rom weights of the samples at -1, 0, 1, 2 for the place t in 0..1."""
    return (
        ((2 - t) * t - 1) * t / 2,
        ((3 * t - 5) * t * t + 2) / 2,
        ((4 - 3 * t) * t + 1) * t / 2,
        (t - 1) * t * t / 2,
    )
