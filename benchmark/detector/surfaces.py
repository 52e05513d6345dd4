"""Backgrounds and occluders with the statistics of photographs.

Natural images look as if opaque things of all sizes had fallen onto each other ('dead leaves'): that gives edges of
all lengths and contrasts, junctions, and clutter at every scale. The leaves here are polygons and irregular blobs,
never ellipses.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def textured(rng: np.random.Generator, shape: tuple[int, ...], grey: float, amplitude: float) -> Array:
    """(H, W) grey levels of a surface: a mean, a gradient of the light, and texture of several scales."""
    height, width = shape[:2]
    ys, xs = np.mgrid[0:height, 0:width]
    slope = rng.normal(0, 15, 2)
    surface = grey + slope[0] * (xs / width - 0.5) + slope[1] * (ys / height - 0.5)
    if amplitude > 0:
        surface = surface + amplitude * noise(rng, (height, width))
    return np.asarray(np.clip(surface, 0, 255))


def noise(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Noise of unit deviation whose power falls with the frequency."""
    total = np.zeros(size)
    for octave in (1, 2, 4, 8, 16):
        coarse = rng.normal(size=(size[0] // octave + 2, size[1] // octave + 2))
        fine = cv2.resize(coarse, (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
        total += fine * octave ** rng.uniform(0.2, 0.9)
    return np.asarray(total / max(total.std(), 1e-9))


def leaf(rng: np.random.Generator, shape: tuple[int, ...], centre: Array, radius: float) -> Array:
    """(H, W) opacity of one polygon or blob."""
    mask = np.zeros(shape[:2], np.uint8)
    if rng.random() < 0.5:
        count = int(rng.integers(3, 7))
        angles = np.sort(rng.uniform(0, 2 * np.pi, count))
        radii = radius * rng.uniform(0.5, 1.2, count)
    else:
        angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
        radii = np.full(60, radius)
        for harmonic in range(2, 6):
            swing = rng.uniform(0.1, 0.5) / harmonic
            radii = radii * (1 + swing * np.cos(harmonic * angles + rng.uniform(0, 2 * np.pi)))
    outline = centre + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    cv2.fillPoly(mask, [np.round(outline * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    return np.asarray(mask / 255.0)


def dead_leaves(rng: np.random.Generator, size: tuple[int, int], count: int) -> Array:
    """(H, W) a background of ``count`` leaves, large ones rarer than small ones."""
    canvas = textured(rng, size, rng.uniform(40, 210), rng.uniform(0, 10))
    for _ in range(count):
        radius = min(8 / (1e-3 + rng.random()) ** 0.8, 0.5 * min(size))
        cover = leaf(rng, size, rng.uniform(0, 1, 2) * (size[1], size[0]), radius)
        rows, columns = np.flatnonzero(cover.any(axis=1)), np.flatnonzero(cover.any(axis=0))
        if len(rows) == 0:
            continue
        window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        grey = float(np.clip(np.median(canvas[window]) + rng.normal(0, 45), 5, 250))
        surface = textured(rng, canvas[window].shape, grey, float(rng.choice([0.0, 3.0, 10.0, 20.0])))
        canvas[window] += cover[window] * (surface - canvas[window])
    return canvas


def letters_without_rings(codes: NDArray[np.int64]) -> str:
    """The characters of some codes, but none that is an ellipse itself, such as an O, which nobody would annotate."""
    return "".join(map(chr, codes)).translate(str.maketrans("0689OQ", "1457XK"))
