"""Drawn scenes that come close to photographs: things of ``objects.py`` on the backgrounds of ``surfaces.py``."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmark.detector.objects import NOBODY, Picture, add_object, random_outline
from benchmark.detector.surfaces import TEXTURES, dead_leaves, leaf
from vision.geometry.ellipse import Ellipse

Array = NDArray[np.float64]

PHOTOGRAPHIC = ("thin", "cut", "soft", "scene", "tiny", "half", "faint")
_SEMI_MAJOR_PX = {"thin": (25.0, 0.4), "tiny": (6.5, 0.04)}  # smallest; largest over the shorter side of the picture
_AXES = {"thin": (0.2, 0.4), "tiny": (0.6, 1.0)}
_COVERED = {"scene": 0.5, "half": 1.0}  # share of the things that have something in front of them


def compose(rng: np.random.Generator, split: str, category: str) -> tuple[Array, list[tuple[Ellipse, float, float]]]:
    """A scene of one of the photographic categories.

    Args:
        rng: all randomness comes from here.
        split: decides the textures.
        category: 'thin' (axes 1:5 to 1:2.5), 'cut' (by the border), 'soft' (contours of several pixels), 'tiny' (from
            6.5 px), 'half' (every thing has something in front of it), 'faint' (a picture of little contrast), or
            'scene' (everything together).

    Returns:
        The picture (H, W), out of focus but without noise, and every elliptic outline with the share of it that is
        plain to see, and that which is at least faint.
    """
    size = (int(rng.integers(300, 700)), int(rng.integers(400, 900)))
    texture = TEXTURES[split][int(rng.integers(len(TEXTURES[split])))]
    leaves = dead_leaves(rng, size, int(np.exp(rng.uniform(np.log(8), np.log(150)))), texture)
    picture = Picture.on(leaves, texture)
    placed = _place(rng, picture, category)
    for outline in placed:
        if rng.random() < _COVERED.get(category, 0.0):
            _occlude(rng, picture, outline)
    picture.canvas = _defocus(rng, picture.canvas)
    if category == "faint":
        picture.canvas = picture.canvas.mean() + rng.uniform(0.12, 0.4) * (picture.canvas - picture.canvas.mean())
    seen = [(e, *picture.visible_shares(e, number)) for e, number in picture.outlines]
    return picture.canvas, seen + [(e, 0.0, 1.0) for e in picture.unasked]


def _place(rng: np.random.Generator, picture: Picture, category: str) -> list[Ellipse]:
    """Put things where there is room for them; their outermost outlines."""
    size = picture.canvas.shape
    smallest, largest = _SEMI_MAJOR_PX.get(category, (14.0, 0.4))
    reach = (smallest, max(largest * min(size), 1.5 * smallest))
    placed: list[Ellipse] = []
    for _ in range(int(rng.integers(2, 20 if category == "tiny" else 8))):
        cut = category == "cut" or (category == "scene" and rng.random() < 0.15)
        outline = random_outline(rng, size, reach, _AXES.get(category, (0.35, 1.0)), cut)
        crowd = 0.5 if category == "scene" else 0.9
        if any(
            np.hypot(*(e.centre - outline.centre)) < crowd * (e.semi_axes[0] + outline.semi_axes[0]) for e in placed
        ):
            continue
        placed.append(outline)
        add_object(rng, picture, outline, soft=category == "soft")
    return placed


def _defocus(rng: np.random.Generator, canvas: Array) -> Array:
    """Blur of one or several pixels, now and then by a disc or along a line instead of a Gaussian."""
    kind = rng.random()
    if kind < 0.7:
        return np.asarray(cv2.GaussianBlur(canvas, (0, 0), float(rng.uniform(0.5, 2.0))))
    kernel = np.zeros((9, 9))
    if kind < 0.85:
        cv2.circle(kernel, (4, 4), int(rng.integers(1, 4)), 1.0, -1)
    else:
        kernel[4, 4 - int(rng.integers(1, 3)) : 5 + int(rng.integers(1, 3))] = 1.0
    return np.asarray(cv2.filter2D(canvas, -1, kernel / kernel.sum()))


def _occlude(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """Put a textured leaf across a part of an outline."""
    at = outline.sample(64)[int(rng.integers(64))]
    cover = leaf(rng, picture.canvas.shape, at, rng.uniform(0.3, 0.9) * outline.semi_axes[0])
    surface = picture.surface(rng, rng.uniform(10, 245), float(rng.choice([0.0, 4.0, 15.0])))
    picture.paint(cover, surface, NOBODY)
