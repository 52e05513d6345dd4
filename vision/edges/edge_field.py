"""Edge evidence around a projected contour: does an edge run here, in this direction, and exactly where?"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays
from vision.kernels import njit

Array = NDArray[np.float64]
Image = NDArray[np.float32]

SMOOTHING_PX = 1.0
CANNY_LOW, CANNY_HIGH = 8.0, 18.0  # 3x3 Sobel units of the smoothed image; its noise at grey sigma 2 is about 2
LOOSEST_ALIGNMENT, FULL_ALIGNMENT = np.cos(np.radians([35.0, 15.0])).tolist()  # of gradient and contour normal
MINIMUM_SLOPE = 2.0  # grey levels per pixel, below which there is no edge

_STEP_PX = 0.5
"""Between the samples of a profile across the contour."""


class StackedEdges(NamedTuple):
    """The edge fields of V views as the compiled loops read them, and what known parts take from them; written to.

    Attributes:
        distance: (V, H, W) float32, pixels to the nearest edge pixel; infinite where edges have been claimed.
        direction: (V, H, W, 2) float32, unit gradient at that edge pixel.
        nearest: (V, H, W, 2) float32, that edge pixel's x and y; -1 without edges.
        claimed: (V, H, W) bool, which edges have been claimed.
        cover: (V, h, w) float32, the depth beyond which known parts hide what is there, by blocks of pixels.
    """

    distance: Image
    direction: Image
    nearest: Image
    claimed: NDArray[np.bool_]
    cover: Image


@dataclass(frozen=True, eq=False)
@frozen_arrays
class EdgeField:
    """For every pixel, how far the nearest edge is and which way it faces.

    Attributes:
        smooth: (H, W) float32, the smoothed grey image.
        distance: (H, W) float32, pixels to the nearest edge pixel.
        direction: (H, W, 2) float32, unit gradient (x, y) at that edge pixel.
        nearest: (H, W, 2) float32, that edge pixel's x and y; -1 in an image without edges.
    """

    smooth: Image
    distance: Image
    direction: Image
    nearest: Image

    @classmethod
    def from_gray(cls, gray: NDArray[np.uint8]) -> EdgeField:
        """Build the field of a grey image (H, W)."""
        smooth = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), SMOOTHING_PX)
        gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
        edges = cv2.Canny(gx.astype(np.int16), gy.astype(np.int16), CANNY_LOW, CANNY_HIGH, L2gradient=True)
        if not edges.any():
            shape = gray.shape
            nothing = np.zeros((*shape, 2), np.float32)
            return cls(smooth, np.full(shape, np.inf, np.float32), nothing, nothing - 1)
        distance, labels = cv2.distanceTransformWithLabels(
            cv2.bitwise_not(edges), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
        )
        direction, nearest = _of_nearest_edge(edges, labels, gx, gy)
        return cls(smooth, np.asarray(distance, np.float32), direction, nearest)

    def support(self, points: Array, normals: Array, reach_px: float = 3.0) -> Array:
        """How well an edge runs through each point, 0 to 1.

        1 where an edge lies within a pixel and its gradient is along the normal, falling to 0 at ``reach_px`` and at
        35 degrees between gradient and normal; 0 outside the image.

        Args:
            points: (N, 2) pixels.
            normals: (N, 2) unit normals of the contour; their sign does not matter.
            reach_px: tolerance.
        """
        height, width = self.distance.shape
        with np.errstate(invalid="ignore"):
            x, y = np.round(points[:, 0]), np.round(points[:, 1])
            inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        columns, rows = np.where(inside, x, 0).astype(np.intp), np.where(inside, y, 0).astype(np.intp)
        near = np.clip((reach_px - self.distance[rows, columns]) / (reach_px - 1.0), 0, 1)
        alignment = np.abs(np.einsum("ij,ij->i", self.direction[rows, columns], normals))
        aligned = np.clip((alignment - LOOSEST_ALIGNMENT) / (FULL_ALIGNMENT - LOOSEST_ALIGNMENT), 0, 1)
        return np.where(inside, near * aligned, 0.0)

    def slope(self, points: Array, normals: Array) -> Array:
        """Grey levels per pixel (N,) along unit normals (N, 2) at points (N, 2); NaN outside the image."""
        values = []
        for sign in (1.0, -1.0):
            x, y = (points + sign * 0.5 * normals).astype(np.float32).T
            values.append(np.asarray(cv2.remap(self.smooth, x[:, None], y[:, None], cv2.INTER_LINEAR))[:, 0])
        return np.where(self.inside(points, 1.0), values[0] - values[1], np.nan)

    def inside(self, points: Array, margin_px: float = 2.0) -> NDArray[np.bool_]:
        """Which of the points (N, 2) lie in the image, ``margin_px`` from its border."""
        height, width = self.distance.shape
        with np.errstate(invalid="ignore"):
            return np.asarray(
                (points[:, 0] >= margin_px)
                & (points[:, 1] >= margin_px)
                & (points[:, 0] <= width - 1 - margin_px)
                & (points[:, 1] <= height - 1 - margin_px)
            )

    def measure(
        self, points: Array, normals: Array, reach_px: float, minimum_slope: float = MINIMUM_SLOPE
    ) -> tuple[Array, Array]:
        """Sub-pixel position of the edge along each normal.

        The intensity profile across the contour is differentiated; among the extrema of the slope that exceed
        ``minimum_slope`` the one is taken whose strength, discounted by its distance, is greatest. A parabola through
        the logarithm of the slope, exact where a step was blurred by a Gaussian, gives its position.

        Args:
            points: (N, 2) pixels.
            normals: (N, 2) unit normals.
            reach_px: how far to look to either side.
            minimum_slope: grey levels per pixel below which there is no edge.

        Returns:
            Offsets (N,) along the normals in pixels, NaN where there is no edge, and signed slopes (N,).
        """
        if len(points) == 0:
            return np.empty(0), np.empty(0)
        positions, slopes = np.empty(len(points)), np.empty(len(points))
        _measure(
            self.smooth,
            np.asarray(points, dtype=float),
            np.asarray(normals, dtype=float),
            profile_weights(reach_px),
            np.float32(minimum_slope),
            positions,
            slopes,
        )
        return positions, slopes


@lru_cache(maxsize=16)
def profile_weights(reach_px: float) -> Array:
    """By how much an edge is discounted at every sample of a profile across the contour; 0 beyond the reach."""
    half = int(np.ceil(reach_px / _STEP_PX)) + 3
    offsets = np.arange(-half, half + 1) * _STEP_PX
    weights = np.exp(-0.5 * (offsets / max(reach_px / 1.5, 0.5)) ** 2)
    weights[np.abs(offsets) > reach_px - 0.5] = 0.0
    return np.asarray(weights)


@njit(cache=True)
def _of_nearest_edge(edges, labels, gx, gy):
    """(H, W, 2) unit gradient at the edge pixel that has the same label, and (H, W, 2) where that pixel is."""
    height, width = edges.shape
    of_label = np.zeros((labels.max() + 1, 4), np.float32)
    for y in range(height):
        for x in range(width):
            if edges[y, x]:
                length = max(np.sqrt(gx[y, x] * gx[y, x] + gy[y, x] * gy[y, x]), np.float32(1e-6))
                row = of_label[labels[y, x]]
                row[0], row[1], row[2], row[3] = gx[y, x] / length, gy[y, x] / length, x, y
    direction = np.empty((height, width, 2), np.float32)
    nearest = np.empty((height, width, 2), np.float32)
    for y in range(height):
        for x in range(width):
            row = of_label[labels[y, x]]
            direction[y, x, 0], direction[y, x, 1], nearest[y, x, 0], nearest[y, x, 1] = row
    return direction, nearest


@njit(cache=True)
def _measure(smooth, points, normals, weights, minimum_slope, positions, slopes):
    """Write what :meth:`EdgeField.measure` returns."""
    profile, slope = np.empty(len(weights), np.float32), np.zeros(len(weights), np.float32)
    for i in range(len(points)):
        positions[i], slopes[i] = np.nan, 0.0
        x, y, nx, ny = points[i, 0], points[i, 1], normals[i, 0], normals[i, 1]
        if np.isfinite(x + y + nx + ny):
            positions[i], slopes[i] = edge_along(smooth, x, y, nx, ny, weights, profile, slope, minimum_slope)


@njit(cache=True)
def edge_along(smooth, x, y, nx, ny, weights, profile, slope, minimum_slope=MINIMUM_SLOPE):
    """Offset and signed slope of the edge along one normal, see :meth:`EdgeField.measure`; NaN and 0 without an edge.

    Args:
        smooth: (H, W) float32, the smoothed grey image.
        x: of the point, pixels.
        y: of the point, pixels.
        nx: of the unit normal.
        ny: of the unit normal.
        weights: (P,) of the profile's samples, 0 where no edge is looked for.
        profile: (P,) float32, scratch.
        slope: (P,) float32, scratch whose first and last two elements are 0.
        minimum_slope: below which there is no edge.
    """
    half = len(weights) // 2
    for k in range(len(weights)):
        offset = (k - half) * _STEP_PX
        profile[k] = _interpolate(smooth, x + offset * nx, y + offset * ny)
    # Over two pixels: a shorter difference of linearly interpolated values depends on where the pixels lie.
    for k in range(2, len(slope) - 2):
        slope[k] = (profile[k + 2] - profile[k - 2]) / np.float32(4 * _STEP_PX)
    best, greatest = -1, 0.0
    for k in range(1, len(slope) - 1):
        here = abs(slope[k])
        is_peak = here >= abs(slope[k - 1]) and here > abs(slope[k + 1]) and here > minimum_slope
        if is_peak and here * weights[k] > greatest:
            best, greatest = k, here * weights[k]
    if best < 0:
        return np.nan, 0.0
    before, at, after = _log_strength(slope[best - 2]), _log_strength(slope[best]), _log_strength(slope[best + 2])
    curvature = before - 2 * at + after
    shift = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    return ((best - half) + 2 * min(max(shift, -1.0), 1.0)) * _STEP_PX, float(slope[best])


@njit(cache=True)
def _log_strength(slope):
    """Logarithm of the size of a slope."""
    return np.log(max(float(abs(slope)), 1e-3))


@njit(cache=True, fastmath={"contract"})
def _interpolate(image, x, y):
    """Bilinear value of an image (H, W) float32 at (x, y); beyond the border the border goes on."""
    height, width = image.shape
    # In single precision with fused products, bit for bit as cv2.remap; far outside would not fit into whole numbers.
    x, y = np.float32(min(max(x, -1.0), float(width))), np.float32(min(max(y, -1.0), float(height)))
    left, top = int(np.floor(x)), int(np.floor(y))
    u, v = x - np.float32(left), y - np.float32(top)
    right, bottom = min(max(left + 1, 0), width - 1), min(max(top + 1, 0), height - 1)
    left, top = min(max(left, 0), width - 1), min(max(top, 0), height - 1)
    upper = image[top, left] + u * (image[top, right] - image[top, left])
    lower = image[bottom, left] + u * (image[bottom, right] - image[bottom, left])
    return upper + v * (lower - upper)
