"""The three forms of an ellipse and the ways between them, compiled.

Focal: p = (u1, v1, u2, v2, s) of the paper's eq. (3), two focal points and the sum of the distances from them.
Geometric: centre x, y, semi-major, semi-minor axis, and the angle of the major one from x towards y.
Conic: the symmetric matrix C with (u, v, 1) C (u, v, 1)ᵀ = 0 on the boundary.
"""

from __future__ import annotations

import numpy as np

from vision.kernels import njit

_LEAST_SLOPE = 1e-3


@njit(cache=True)
def norm2(x, y):
    """Length of a vector of moderate size; several times as fast as np.hypot, which heeds overflow."""
    return np.sqrt(x * x + y * y)


@njit(cache=True)
def conic_to_geometric(xx, xy, yy, x1, y1, one, out):
    """Write the geometric form (5,) of a conic, given by its six elements; False where it is no real ellipse.

    The sign of the conic is free.
    """
    determinant = xx * yy - xy * xy
    if not determinant > 0:
        return False
    x, y = (xy * y1 - yy * x1) / determinant, (xy * x1 - xx * y1) / determinant
    mean, spread = 0.5 * (xx + yy), norm2(0.5 * (xx - yy), xy)
    value = -(x1 * x + y1 * y + one)
    if mean < 0:
        mean, value, xx, xy, yy = -mean, -value, -xx, -xy, -yy
    smaller = determinant / (mean + spread)  # mean - spread, without the loss of digits where the ellipse is flat
    if not (value > 0 and smaller > 0 and np.isfinite(value)):
        return False
    out[0], out[1] = x, y
    out[2], out[3] = np.sqrt(value / smaller), np.sqrt(value / (mean + spread))
    out[4] = (0.5 * np.arctan2(2 * xy, xx - yy) + 0.5 * np.pi) % np.pi
    return True


@njit(cache=True)
def conics_to_geometric(conics):
    """Geometric forms (N, 5) of conics (N, 3, 3); NaN where one is no real ellipse."""
    out = np.empty((len(conics), 5))
    for k in range(len(conics)):
        c = conics[k]
        if not conic_to_geometric(c[0, 0], c[0, 1], c[1, 1], c[0, 2], c[1, 2], c[2, 2], out[k]):
            out[k] = np.nan
    return out


@njit(cache=True)
def geometric_to_conic(geometric):
    """The conic (3, 3), negative inside, of a geometric form (5,)."""
    x, y, semi_major, semi_minor, angle = geometric
    c, s = np.cos(angle) / semi_major, np.sin(angle) / semi_major
    along = np.array([c, s, -(c * x + s * y)])
    c, s = np.cos(angle) / semi_minor, np.sin(angle) / semi_minor
    across = np.array([-s, c, s * x - c * y])
    conic = np.outer(along, along) + np.outer(across, across)
    conic[2, 2] -= 1
    return conic


@njit(cache=True)
def geometric_to_focal(geometric, p):
    """Write the focal form (5,) of a geometric one (5,)."""
    x, y, semi_major, semi_minor, angle = geometric
    half = np.sqrt(max(semi_major**2 - semi_minor**2, 0.0))
    u, v = half * np.cos(angle), half * np.sin(angle)
    p[0], p[1], p[2], p[3], p[4] = x + u, y + v, x - u, y - v, 2 * semi_major


@njit(cache=True)
def axes(p):
    """Centre, semi-axes, and direction of the major axis (cosine and sine) of a focal form (5,)."""
    dx, dy = 0.5 * (p[0] - p[2]), 0.5 * (p[1] - p[3])
    focal = norm2(dx, dy)
    major = 0.5 * p[4]
    minor = np.sqrt(max((major - focal) * (major + focal), 0.0))
    cos, sin = (dx / focal, dy / focal) if focal > 1e-9 else (1.0, 0.0)
    return 0.5 * (p[0] + p[2]), 0.5 * (p[1] + p[3]), major, minor, cos, sin


@njit(cache=True)
def focal_to_geometric(p, out):
    """Write the geometric form (5,) of a focal one (5,)."""
    out[0], out[1], out[2], out[3], cos, sin = axes(p)
    out[4] = np.arctan2(sin, cos) % np.pi


@njit(cache=True)
def focals_to_geometric(ps):
    """Geometric forms (N, 5) of focal ones (N, 5)."""
    out = np.empty(ps.shape)
    for k in range(len(ps)):
        focal_to_geometric(ps[k], out[k])
    return out


@njit(cache=True)
def focals_to_conics(ps):
    """Conics (N, 3, 3), negative inside, of focal forms (N, 5)."""
    geometric, out = np.empty(5), np.empty((len(ps), 3, 3))
    for k in range(len(ps)):
        focal_to_geometric(ps[k], geometric)
        out[k] = geometric_to_conic(geometric)
    return out


@njit(cache=True)
def residual(p, x, y):
    """Residual f of eq. (3) at a point, and all that its derivatives need.

    Returns:
        f = |z - P1| + |z - P2| - s, the unit vectors (x, y) from P1 and from P2 to the point, and the length of their
        sum, |df/dz|. df/dp is minus the first vector, minus the second, and -1.
    """
    ax, ay, bx, by = x - p[0], y - p[1], x - p[2], y - p[3]
    s1, s2 = max(norm2(ax, ay), 1e-9), max(norm2(bx, by), 1e-9)
    ax, ay, bx, by = ax / s1, ay / s1, bx / s2, by / s2
    return s1 + s2 - p[4], ax, ay, bx, by, max(norm2(ax + bx, ay + by), _LEAST_SLOPE)


@njit(cache=True)
def signed_distance(p, x, y):
    """First-order distance of a point to the ellipse p: f of eq. (3) over |df/dz|; positive outside."""
    f, _, _, _, _, slope = residual(p, x, y)
    return f / slope


@njit(cache=True)
def measure(p, points, distance, slope):
    """Write the :func:`signed_distance` of points (N, 2) to p into ``distance`` (N,), and |df/dz| into ``slope``."""
    for k in range(len(points)):
        f, _, _, _, _, slope[k] = residual(p, points[k, 0], points[k, 1])
        distance[k] = f / slope[k]
