"""Backgrounds and occluders with the statistics of photographs.

Natural images look as if opaque things of all sizes had fallen onto each other ('dead leaves'): that gives edges of
all lengths and contrasts, junctions, and clutter at every scale. The leaves here are polygons and irregular blobs,
never ellipses.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Texture = Callable[[np.random.Generator, tuple[int, int]], Array]
"""(H, W) grey levels of unit deviation."""


def textured(
    rng: np.random.Generator, shape: tuple[int, ...], grey: float, amplitude: float, texture: Texture
) -> Array:
    """(H, W) grey levels of a surface: a mean, a gradient of the light, and texture of several scales."""
    height, width = shape[:2]
    ys, xs = np.mgrid[0:height, 0:width]
    slope = rng.normal(0, 15, 2)
    surface = grey + slope[0] * (xs / width - 0.5) + slope[1] * (ys / height - 0.5)
    if amplitude > 0:
        surface = surface + amplitude * texture(rng, (height, width))
    return np.asarray(np.clip(surface, 0, 255))


def clouds(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Noise whose power falls with the frequency, as stone, skin and foliage have it."""
    total = np.zeros(size)
    for octave in (1, 2, 4, 8, 16):
        coarse = rng.normal(size=(size[0] // octave + 2, size[1] // octave + 2))
        fine = cv2.resize(coarse, (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
        total += fine * octave ** rng.uniform(0.2, 0.9)
    return np.asarray(total / max(total.std(), 1e-9))


def cells(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Patches of one grey level each with straight borders, as gravel and leather have them."""
    seeds = rng.random(size) > rng.uniform(0.003, 0.03)
    _, labels = cv2.distanceTransformWithLabels(
        seeds.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    total = rng.normal(size=int(labels.max()) + 1)[labels] + 0.3 * rng.normal(size=size)
    return np.asarray(total / max(total.std(), 1e-9))


def weave(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """Threads that cross, unevenly spun, as cloth and baskets have them."""
    ys, xs = np.mgrid[0 : size[0], 0 : size[1]].astype(float)
    angle, period = rng.uniform(0, np.pi), rng.uniform(4, 14)
    wobble = cv2.GaussianBlur(rng.normal(size=size), (0, 0), 3 * period)
    wobble *= 1.5 / max(wobble.std(), 1e-9)
    u = 2 * np.pi * (xs * np.cos(angle) + ys * np.sin(angle)) / period + wobble
    v = 2 * np.pi * (ys * np.cos(angle) - xs * np.sin(angle)) / period + wobble
    total = np.where(np.sin(u) * np.sin(v) > 0, np.sin(u), np.sin(v)) + 0.3 * rng.normal(size=size)
    return np.asarray(total / max(total.std(), 1e-9))


TEXTURES: dict[str, tuple[Texture, ...]] = {"tune": (clouds,), "test": (cells, weave)}
"""By split, so that nothing is chosen on the textures that it is judged on."""


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


def dead_leaves(rng: np.random.Generator, size: tuple[int, int], count: int, texture: Texture) -> Array:
    """(H, W) a background of ``count`` leaves, large ones rarer than small ones."""
    canvas = textured(rng, size, rng.uniform(40, 210), rng.uniform(0, 10), texture)
    for _ in range(count):
        radius = min(8 / (1e-3 + rng.random()) ** 0.8, 0.5 * min(size))
        cover = leaf(rng, size, rng.uniform(0, 1, 2) * (size[1], size[0]), radius)
        rows, columns = np.flatnonzero(cover.any(axis=1)), np.flatnonzero(cover.any(axis=0))
        if len(rows) == 0:
            continue
        window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        grey = float(np.clip(np.median(canvas[window]) + rng.normal(0, 45), 5, 250))
        amplitude = float(rng.choice([0.0, 3.0, 10.0, 20.0]))
        surface = textured(rng, canvas[window].shape, grey, amplitude, texture)
        canvas[window] += cover[window] * (surface - canvas[window])
    return canvas


def letters_without_rings(codes: NDArray[np.int64]) -> str:
    """The characters of some codes, but none that is an ellipse itself, such as an O, which nobody would annotate."""
    return "".join(map(chr, codes)).translate(str.maketrans("0689OQ", "1457XK"))
