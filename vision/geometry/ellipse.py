"""The ellipse in the focal form of the paper's eq. (3), and its way to and from other forms.

An ellipse is p = (u1, v1, u2, v2, s): two focal points and the sum s of the distances from them to any boundary
point. Unlike (centre, axes, angle), the form stays smooth where the ellipse is a circle: the two focal points
merely coincide.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.focal_form import conic_to_geometric, focals_to_conics, focals_to_geometric, measure

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Ellipse:
    """An ellipse in the image, in pixels.

    Attributes:
        p: (5,) focal parameters (u1, v1, u2, v2, s) of eq. (3); s exceeds the distance of the focal points.
        covariance: (5, 5) covariance of p in px², or None where it is not known.
    """

    p: Array
    covariance: Array | None = None

    def __post_init__(self) -> None:
        p = np.array(self.p, dtype=float)
        if p.shape != (5,) or not np.isfinite(p).all() or p[4] <= np.hypot(p[0] - p[2], p[1] - p[3]):
            raise InputError(
                "focal parameters of an ellipse", got=p.tolist(), expected="5 finite numbers with s > |P1 P2|"
            )
        object.__setattr__(self, "p", p)
        if self.covariance is not None:
            object.__setattr__(self, "covariance", np.array(self.covariance, dtype=float))

    @classmethod
    def from_geometric(cls, x: float, y: float, semi_major: float, semi_minor: float, angle: float) -> Ellipse:
        """From centre, semi-axes in pixels and the angle of the major axis in radians (x towards y)."""
        focal = np.sqrt(max(semi_major**2 - semi_minor**2, 0.0)) * np.array([np.cos(angle), np.sin(angle)])
        return cls(np.array([x + focal[0], y + focal[1], x - focal[0], y - focal[1], 2 * semi_major]))

    @classmethod
    def from_conic(cls, conic: ArrayLike) -> Ellipse:
        """From the symmetric 3x3 matrix C with (u, v, 1) C (u, v, 1)ᵀ = 0 on the boundary.

        Raises:
            InputError: when the conic is not a real ellipse.
        """
        c = np.asarray(conic, dtype=float)
        geometric = np.empty(5)
        if not conic_to_geometric(c[0, 0], c[0, 1], c[1, 1], c[0, 2], c[1, 2], c[2, 2], geometric):
            raise InputError("conic", got=c.tolist(), expected="a real ellipse, not a point or imaginary")
        return cls.from_geometric(*geometric)

    @property
    def centre(self) -> Array:
        """(2,) the point midway between the focal points."""
        return (self.p[:2] + self.p[2:4]) / 2

    @property
    def semi_axes(self) -> tuple[float, float]:
        """Semi-major and semi-minor axis in pixels."""
        semi_major = self.p[4] / 2
        half_focal_distance = np.hypot(*(self.p[:2] - self.p[2:4])) / 2
        return float(semi_major), float(np.sqrt(semi_major**2 - half_focal_distance**2))

    @property
    def angle(self) -> float:
        """Angle of the major axis in [0, pi), radians from x towards y; 0 for a circle."""
        d = self.p[:2] - self.p[2:4]
        return float(np.arctan2(d[1], d[0]) % np.pi) if d.any() else 0.0

    @property
    def geometric(self) -> Array:
        """(5,) centre x, centre y, semi-major, semi-minor, angle."""
        return geometric_parameters(self.p)

    @property
    def area(self) -> float:
        """Area in px²."""
        semi_major, semi_minor = self.semi_axes
        return float(np.pi * semi_major * semi_minor)

    @property
    def conic(self) -> Array:
        """The symmetric 3x3 matrix C with (u, v, 1) C (u, v, 1)ᵀ = 0 on the boundary, < 0 inside."""
        return conic_matrices(self.p)

    def sample(self, n: int) -> Array:
        """(n, 2) boundary points at equal steps of the eccentric angle, in the direction from x towards y."""
        t = np.linspace(0, 2 * np.pi, n, endpoint=False)
        semi_major, semi_minor = self.semi_axes
        c, s = np.cos(self.angle), np.sin(self.angle)
        along, across = semi_major * np.cos(t), semi_minor * np.sin(t)
        return self.centre + np.column_stack([c * along - s * across, s * along + c * across])

    def distance(self, points: ArrayLike) -> Array:
        """Distance in pixels of points (N, 2) to the boundary: f of eq. (3) over |df/dz|, negative inside."""
        return focal_distances(self.p, np.atleast_2d(np.asarray(points, dtype=float)))[0]

    def normals(self, points: ArrayLike) -> Array:
        """Unit normals (N, 2), pointing outwards, of the concentric ellipses of this shape through points (N, 2)."""
        homogeneous = np.column_stack([np.atleast_2d(points), np.ones(len(np.atleast_2d(points)))])
        gradient = (homogeneous @ self.conic)[:, :2]
        return np.asarray(gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12))

    def variance_across(self, points: ArrayLike) -> Array:
        """Variance (N,) in px² of where the outline runs, across itself, at points (N, 2) on it; 0 if not known.

        Small along the arc that was seen and large on the other side of the ellipse.
        """
        points = np.atleast_2d(np.asarray(points, dtype=float))
        if self.covariance is None:
            return np.zeros(len(points))
        J = focal_jacobian(self.p, points)
        steepness = np.maximum(np.linalg.norm(J[:, :2] + J[:, 2:4], axis=1), 1e-3)
        return np.einsum("ij,jk,ik->i", J, self.covariance, J) / steepness**2


def geometric_parameters(p: Array) -> Array:
    """(..., 5) centre x, y, semi-major, semi-minor and angle of ellipses with focal parameters (..., 5)."""
    return np.asarray(focals_to_geometric(np.ascontiguousarray(p).reshape(-1, 5))).reshape(p.shape)


def conic_matrices(p: Array) -> Array:
    """The matrices (..., 3, 3) of :attr:`Ellipse.conic` of ellipses with focal parameters (..., 5)."""
    return np.asarray(focals_to_conics(np.ascontiguousarray(p).reshape(-1, 5))).reshape(*p.shape[:-1], 3, 3)


def focal_distances(p: Array, points: Array) -> tuple[Array, Array]:
    """Signed distances (N,) of points (N, 2) to the ellipse p, to first order, and |df/dz| (N,)."""
    distance, slope = np.empty(len(points)), np.empty(len(points))
    measure(np.asarray(p, dtype=float), np.ascontiguousarray(points), distance, slope)
    return distance, slope


def focal_residual(p: Array, points: Array) -> Array:
    """f(p, z) = |z - P1| + |z - P2| - s of eq. (3) for points (N, 2): (N,) pixels, about twice the distance."""
    return np.asarray(
        np.hypot(points[:, 0] - p[0], points[:, 1] - p[1]) + np.hypot(points[:, 0] - p[2], points[:, 1] - p[3]) - p[4]
    )


def focal_jacobian(p: Array, points: Array) -> Array:
    """df/dp of eq. (3) for points (N, 2): (N, 5)."""
    d1, d2 = p[:2] - points, p[2:4] - points
    s1 = np.maximum(np.hypot(d1[:, 0], d1[:, 1]), 1e-9)[:, None]
    s2 = np.maximum(np.hypot(d2[:, 0], d2[:, 1]), 1e-9)[:, None]
    return np.hstack([d1 / s1, d2 / s2, -np.ones((len(points), 1))])


def overlap(a: Ellipse, b: Ellipse, resolution: int = 256) -> float:
    """Intersection over union of two filled ellipses, by rasterising at sub-pixel resolution.

    Args:
        a: one ellipse.
        b: the other.
        resolution: cells of the grid along the longer side of the common bounding box.
    """
    reach = a.semi_axes[0] + b.semi_axes[0]
    if np.hypot(*(a.centre - b.centre)) >= reach or min(a.area, b.area) <= 0:
        return 0.0
    outline = np.vstack([a.sample(64), b.sample(64)])
    low, high = outline.min(axis=0), outline.max(axis=0)
    scale = (resolution - 3) / max(*(high - low), 1e-9)
    size = np.ceil((high - low) * scale).astype(int) + 3
    masks = [_fill(e, low, scale, size) for e in (a, b)]
    union = np.count_nonzero(masks[0] | masks[1])
    return float(np.count_nonzero(masks[0] & masks[1]) / union) if union else 0.0


def _fill(ellipse: Ellipse, low: Array, scale: float, size: NDArray[np.int_]) -> NDArray[np.uint8]:
    """The ellipse as a mask on a grid of ``size`` (width, height) cells, ``scale`` cells per pixel."""
    fraction_bits = 6
    mask = np.zeros((size[1], size[0]), np.uint8)
    polygon = ((ellipse.sample(128) - low) * scale + 1) * 2**fraction_bits
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1, shift=fraction_bits)
    return mask
