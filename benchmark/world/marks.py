"""What use and manufacture leave on surfaces: cast grain, turning grooves, dirt and scratches, as a texture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]


def surface_marks(rng: np.random.Generator, size_px: int, strength: float, *, turned: bool) -> NDArray[np.uint8]:
    """A grey texture (size, size) by which a surface's colour is multiplied; all 255 at strength 0.

    Args:
        rng: the source of the marks.
        size_px: edge length of the texture.
        strength: contrast, 0 to 1.
        turned: add the concentric grooves of a lathe around the texture's centre.
    """
    if strength == 0:
        return np.full((size_px, size_px), 255, np.uint8)
    grain = 0.05 * _noise(rng, size_px, 2) + 0.04 * _noise(rng, size_px, 5)
    cloud = 0.10 * _noise(rng, size_px, size_px // 8)
    dirt = 0.35 * np.clip(_noise(rng, size_px, size_px // 24) - 1.3, 0, 1)
    field = 0.86 + grain + cloud - dirt - 0.15 * _scratches(rng, size_px, 14)
    if turned:
        field += 0.05 * _grooves(rng, size_px)
    return np.asarray(255 * np.clip(1 - strength * (1 - field), 0.2, 1), dtype=np.uint8)


def _noise(rng: np.random.Generator, size_px: int, grain_px: int) -> Field:
    """Smooth noise of unit deviation whose blobs are about `grain_px` wide."""
    coarse = rng.standard_normal((size_px // grain_px + 2,) * 2, dtype=np.float32)
    field = cv2.resize(coarse, (size_px, size_px), interpolation=cv2.INTER_CUBIC)
    return np.asarray(field / field.std(), dtype=np.float32)


def _grooves(rng: np.random.Generator, size_px: int) -> Field:
    """Unit-deviation noise that depends on the distance from the centre alone."""
    axis = np.arange(size_px) - (size_px - 1) / 2
    radius = np.hypot(axis[:, None], axis[None, :])
    profile = rng.standard_normal(size_px)
    return np.asarray(np.interp(radius, np.arange(size_px), profile), dtype=np.float32)


def _scratches(rng: np.random.Generator, size_px: int, count: int) -> Field:
    canvas = np.zeros((size_px, size_px), np.uint8)
    for _ in range(count):
        start = rng.uniform(0, size_px, 2)
        end = start + rng.normal(scale=size_px / 10, size=2)
        cv2.line(canvas, tuple(start.astype(int).tolist()), tuple(end.astype(int).tolist()), 255, 1, cv2.LINE_AA)
    return np.asarray(canvas / 255, dtype=np.float32)
