"""Edge evidence around a projected contour: does an edge run here, in this direction, and exactly where?"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.float32]

SMOOTHING_PX = 1.0
CANNY_LOW, CANNY_HIGH = 8.0, 18.0  # 3x3 Sobel units of the smoothed image; its noise at grey sigma 2 is about 2


@dataclass(frozen=True, eq=False)
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
            (edges == 0).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
        )
        rows, columns = np.nonzero(edges)
        of_label = np.zeros((labels.max() + 1, 2), np.float32)
        gradient = np.stack([gx[rows, columns], gy[rows, columns]], axis=1)
        of_label[labels[rows, columns]] = gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-6)
        place = np.full((labels.max() + 1, 2), -1, np.float32)
        place[labels[rows, columns]] = np.stack([columns, rows], axis=1)
        return cls(smooth, distance.astype(np.float32), of_label[labels], place[labels])

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
        limit = np.cos(np.radians(35))
        aligned = np.clip((alignment - limit) / (np.cos(np.radians(15)) - limit), 0, 1)
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
        self, points: Array, normals: Array, reach_px: float, minimum_slope: float = 2.0
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
        step = 0.5
        half = int(np.ceil(reach_px / step)) + 3
        offsets = np.arange(-half, half + 1) * step
        where = points[:, None, :] + offsets[None, :, None] * normals[:, None, :]
        good = np.asarray(np.isfinite(where).all(axis=(1, 2)))
        where = np.where(good[:, None, None], where, 0).astype(np.float32)
        profile = np.asarray(
            cv2.remap(self.smooth, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        )
        slope = np.zeros_like(profile)
        # Over two pixels: a shorter difference of linearly interpolated values depends on where the pixels lie.
        slope[:, 2:-2] = (profile[:, 4:] - profile[:, :-4]) / (4 * step)
        strength = np.asarray(np.abs(slope))
        peak = np.zeros(strength.shape, bool)
        peak[:, 1:-1] = (strength[:, 1:-1] >= strength[:, :-2]) & (strength[:, 1:-1] > strength[:, 2:])
        peak = np.asarray(peak & (strength > minimum_slope))
        peak[:, np.abs(offsets) > reach_px - 0.5] = False
        discounted = np.where(peak, strength * np.exp(-0.5 * (offsets / max(reach_px / 1.5, 0.5)) ** 2), 0)
        best = discounted.argmax(axis=1)
        rows = np.arange(len(points))
        found = good & peak[rows, best]
        centre = np.clip(best, 2, len(offsets) - 3)
        before, at, after = (np.log(np.maximum(strength[rows, centre + k].astype(float), 1e-3)) for k in (-2, 0, 2))
        curvature = before - 2 * at + after
        shift = np.where(curvature < 0, 0.5 * (before - after) / np.where(curvature < 0, curvature, 1), 0)
        measured = offsets[best] + np.clip(shift, -1, 1) * 2 * step
        return np.where(found, measured, np.nan), slope[rows, best].astype(float)
