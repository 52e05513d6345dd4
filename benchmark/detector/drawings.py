"""Drawn cluttered images with exactly known ellipses, to judge a detector on.

A drawing is a background (gradient, texture), straight and textured clutter, ellipses of one category, things in
front of them, then blur and noise. An ellipse counts as ground truth where enough of its circumference has contrast
in the clean drawing; those that are hidden further, or faint, are neither asked for nor counted against a detector.
The splits 'tune' and 'test' draw from disjoint seeds and, in scenes, different textures: thresholds are chosen on the
first and reported on the second. The scenes of one category are not drawn but rendered (``renders.py``).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmark.detector.contrast import FAINT_CONTRAST, VISIBLE_CONTRAST, steps_across
from benchmark.detector.photographs import PHOTOGRAPHIC, compose
from benchmark.detector.surfaces import letters_without_rings
from benchmark.seeds import PICTURES
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.ellipse import Ellipse

Array = NDArray[np.float64]

PLAIN = ("complete", "concentric", "occluded", "small", "low_contrast", "clutter")
RENDERED = "rendered"
CATEGORIES = (*PLAIN, *PHOTOGRAPHIC, RENDERED)  # what is added comes last: the place is part of the seed
SPLITS = {"tune": PICTURES["earlier"].start, "test": PICTURES["reported"].start}  # first seed of each
_ASKED_SHARE, _TOLERATED_SHARE = 0.5, 0.2  # of the circumference that has contrast


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Drawing:
    """One drawn image.

    Attributes:
        image: (H, W) uint8.
        ellipses: ground truth.
        tolerated: ellipses that are largely hidden or faint: a detector may report them or not.
        category: one of ``CATEGORIES``.
    """

    image: NDArray[np.uint8]
    ellipses: tuple[Ellipse, ...]
    tolerated: tuple[Ellipse, ...]
    category: str


def draw(split: str, category: str, number: int) -> Drawing:
    """Drawing ``number`` of a category and split; the same arguments give the same image.

    Raises:
        InputError: for an unknown split or category.
        ResourceError: when the machine cannot render what is rendered.
    """
    if split not in SPLITS or category not in CATEGORIES:
        raise InputError("drawing", got=(split, category), expected=f"a split of {list(SPLITS)}, one of {CATEGORIES}")
    rng = np.random.default_rng([SPLITS[split] + number, CATEGORIES.index(category)])
    if category == RENDERED:
        canvas, seen = _render(rng, split)
    elif category in PHOTOGRAPHIC:
        canvas, seen = compose(rng, split, category)
    else:
        canvas, seen = _draw_plain(rng, category)
    ellipses = [e for e, _, _ in seen]
    if category != RENDERED and rng.random() < 0.6:
        canvas, ellipses = _bend(rng, canvas, ellipses)
    return Drawing(
        _photograph(rng, canvas),
        tuple(e for e, (_, plain, _) in zip(ellipses, seen, strict=True) if plain >= _ASKED_SHARE),
        tuple(
            e
            for e, (_, plain, faint) in zip(ellipses, seen, strict=True)
            if plain < _ASKED_SHARE and faint >= _TOLERATED_SHARE
        ),
        category,
    )


def _render(rng: np.random.Generator, split: str) -> tuple[Array, list[tuple[Ellipse, float, float]]]:
    """A rendered scene, and the ellipses in it with their visible shares."""
    from benchmark.detector.renders import compose as compose_solids  # MuJoCo: nothing else here needs it

    return compose_solids(rng, split)


def _draw_plain(rng: np.random.Generator, category: str) -> tuple[Array, list[tuple[Ellipse, float, float]]]:
    """Flat ellipses among straight and textured clutter: the canvas, and the ellipses with their visible shares."""
    size = (int(rng.integers(300, 800)), int(rng.integers(300, 1000)))
    canvas = _background(rng, size)
    _clutter(rng, canvas, int(rng.integers(5, 30 if category != "clutter" else 60)))
    ellipses: list[Ellipse] = []
    if category != "clutter":
        for _ in range(int(rng.integers(2, 9))):
            ellipses += _place(rng, canvas, category, ellipses)
    if category == "occluded":
        _clutter(rng, canvas, int(rng.integers(6, 14)))
    return canvas, [(ellipse, *_visible_shares(canvas, ellipse)) for ellipse in ellipses]


def _bend(rng: np.random.Generator, canvas: Array, ellipses: list[Ellipse]) -> tuple[Array, list[Ellipse]]:
    """Displace everything smoothly by up to a few pixels, because no real outline is a perfect ellipse."""
    height, width = canvas.shape
    scale, strength = float(rng.uniform(10, 50)), rng.uniform(0.3, 2.0)
    fields = [cv2.GaussianBlur(rng.normal(size=canvas.shape), (0, 0), scale) for _ in range(2)]
    dx, dy = (strength * field / field.std() for field in fields)
    xs, ys = np.meshgrid(np.arange(width), np.arange(height))
    maps = (xs + dx).astype(np.float32), (ys + dy).astype(np.float32)
    bent = cv2.remap(canvas, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    moved = []
    for ellipse in ellipses:
        outline = ellipse.sample(64)
        at = np.clip(np.round(outline).astype(int), 0, (width - 1, height - 1))
        outline = outline - np.column_stack([dx[at[:, 1], at[:, 0]], dy[at[:, 1], at[:, 0]]])
        (x, y), (d1, d2), degrees = cv2.fitEllipseDirect(outline.astype(np.float32))
        # OpenCV's angle belongs to the first diameter.
        angle = np.radians(degrees) + (0 if d1 >= d2 else np.pi / 2)
        moved.append(Ellipse.from_geometric(x, y, max(d1, d2) / 2, min(d1, d2) / 2, angle))
    return np.clip(bent, 0, 255), moved


def _photograph(rng: np.random.Generator, canvas: Array) -> NDArray[np.uint8]:
    """What a camera adds: lenses blur, sensors are noisy, files are compressed."""
    image = cv2.GaussianBlur(canvas, (0, 0), float(rng.uniform(0.4, 1.4)))
    image += rng.normal(0, rng.uniform(0.5, 5), canvas.shape)
    grey = np.clip(np.round(image), 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        _, file = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(50, 95))])
        grey = np.asarray(cv2.imdecode(file, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    return grey


def fill_ellipse(canvas: Array, ellipse: Ellipse, grey: float | Array) -> None:
    """Paint a filled ellipse onto a float canvas with exact anti-aliasing, in place."""
    reach = ellipse.semi_axes[0] + 2
    x, y = ellipse.centre
    x0, x1 = max(int(x - reach), 0), min(int(x + reach) + 2, canvas.shape[1])
    y0, y1 = max(int(y - reach), 0), min(int(y + reach) + 2, canvas.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    xs, ys = np.meshgrid(np.arange(x0, x1, dtype=float), np.arange(y0, y1, dtype=float))
    distance = ellipse.distance(np.column_stack([xs.ravel(), ys.ravel()])).reshape(xs.shape)
    cover = np.clip(0.5 - distance, 0, 1)
    patch = canvas[y0:y1, x0:x1]
    paint = grey[y0:y1, x0:x1] if isinstance(grey, np.ndarray) else grey
    patch += cover * (paint - patch)


def _background(rng: np.random.Generator, size: tuple[int, int]) -> Array:
    """A gradient with texture of several scales."""
    height, width = size
    ys, xs = np.mgrid[0:height, 0:width]
    slope = rng.uniform(-40, 40, 2)
    canvas = rng.uniform(50, 200) + slope[0] * (xs / width - 0.5) + slope[1] * (ys / height - 0.5)
    if rng.random() < 0.6:
        canvas = canvas + _texture(rng, size, rng.uniform(3, 20))
    return np.clip(canvas, 0, 255)


def _texture(rng: np.random.Generator, size: tuple[int, int], amplitude: float) -> Array:
    total = np.zeros(size)
    for sigma in (1.0, 2.5, 6.0, 15.0):
        noise = cv2.GaussianBlur(rng.normal(size=size), (0, 0), sigma)
        total += noise / max(noise.std(), 1e-9) * rng.uniform(0, 1)
    return np.asarray(total / max(total.std(), 1e-9) * amplitude)


def _clutter(rng: np.random.Generator, canvas: Array, count: int) -> None:
    """Polygons, lines, gratings, text, textured patches and open curves, in place."""
    kinds = (_polygon, _line, _grating, _text, _patch, _curve)
    for _ in range(count):
        kinds[int(rng.integers(len(kinds)))](rng, canvas)


def _anywhere(rng: np.random.Generator, canvas: Array, count: int, spread: float) -> Array:
    height, width = canvas.shape
    return rng.uniform(0, 1, 2) * (width, height) + rng.uniform(-spread, spread, (count, 2))


def _fixed(points: Array) -> NDArray[np.int32]:
    return np.round(points * 16).astype(np.int32)


def _polygon(rng: np.random.Generator, canvas: Array) -> None:
    points = _anywhere(rng, canvas, int(rng.integers(3, 6)), rng.uniform(15, 120))
    image = canvas.astype(np.uint8)
    mask = np.zeros_like(image)
    cv2.fillConvexPoly(mask, cv2.convexHull(_fixed(points)), 255, cv2.LINE_AA, 4)
    canvas += mask / 255 * (rng.uniform(0, 255) - canvas)


def _line(rng: np.random.Generator, canvas: Array) -> None:
    a, b = _fixed(_anywhere(rng, canvas, 2, 250))
    mask = np.zeros(canvas.shape, np.uint8)
    cv2.line(mask, a.tolist(), b.tolist(), 255, int(rng.integers(1, 8)), cv2.LINE_AA, 4)
    canvas += mask / 255 * (rng.uniform(0, 255) - canvas)


def _curve(rng: np.random.Generator, canvas: Array) -> None:
    """A smooth open curve that is not an ellipse: a Bézier curve."""
    control = _anywhere(rng, canvas, 4, rng.uniform(20, 150))
    t = np.linspace(0, 1, 60)[:, None]
    curve = (1 - t) ** 3 * control[0] + 3 * t * (1 - t) ** 2 * control[1]
    curve = curve + 3 * t**2 * (1 - t) * control[2] + t**3 * control[3]
    mask = np.zeros(canvas.shape, np.uint8)
    cv2.polylines(mask, [_fixed(curve)], False, 255, int(rng.integers(1, 6)), cv2.LINE_AA, 4)
    canvas += mask / 255 * (rng.uniform(0, 255) - canvas)


def _grating(rng: np.random.Generator, canvas: Array) -> None:
    height, width = canvas.shape
    x, y = rng.integers(0, width), rng.integers(0, height)
    w, h = rng.integers(20, 160, 2)
    patch = canvas[y : y + h, x : x + w]
    ys, xs = np.mgrid[0 : patch.shape[0], 0 : patch.shape[1]]
    angle = rng.uniform(0, np.pi)
    phase = (xs * np.cos(angle) + ys * np.sin(angle)) * 2 * np.pi / rng.uniform(5, 25)
    patch[:] = np.clip(rng.uniform(60, 200) + rng.uniform(10, 60) * np.tanh(3 * np.sin(phase)), 0, 255)


def _text(rng: np.random.Generator, canvas: Array) -> None:
    mask = np.zeros(canvas.shape, np.uint8)
    letters = letters_without_rings(rng.integers(65, 91, int(rng.integers(2, 9))))
    at = tuple(int(v) for v in _anywhere(rng, canvas, 1, 1)[0])
    scale, thick = float(rng.uniform(0.5, 2.5)), int(rng.integers(1, 5))
    cv2.putText(mask, letters, at, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, thick, cv2.LINE_AA)
    canvas += mask / 255 * (rng.uniform(0, 255) - canvas)


def _patch(rng: np.random.Generator, canvas: Array) -> None:
    """A rectangle of coarse texture, such as foliage."""
    height, width = canvas.shape
    x, y = rng.integers(0, width), rng.integers(0, height)
    w, h = rng.integers(30, 250, 2)
    patch = canvas[y : y + h, x : x + w]
    blobs = cv2.GaussianBlur(rng.normal(size=patch.shape), (0, 0), rng.uniform(1.5, 5))
    patch[:] = np.clip(rng.uniform(60, 190) + blobs / max(blobs.std(), 1e-9) * rng.uniform(10, 45), 0, 255)


def _place(rng: np.random.Generator, canvas: Array, category: str, others: list[Ellipse]) -> list[Ellipse]:
    """Draw one object with elliptic outlines where it does not collide with the others."""
    height, width = canvas.shape
    low, high = (7.0, 16.0) if category == "small" else (16.0, 0.33 * min(height, width))
    semi_major = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    semi_minor = semi_major * float(rng.uniform(0.35, 1.0)) if rng.random() < 0.85 else semi_major
    semi_minor = max(semi_minor, 5.0)
    margin = semi_major * (0.6 if category == "occluded" else 1.02) + 2
    if 2 * margin >= min(height, width):
        return []
    x, y = rng.uniform(margin, width - margin), rng.uniform(margin, height - margin)
    outer = Ellipse.from_geometric(x, y, max(semi_major, semi_minor), semi_minor, rng.uniform(0, np.pi))
    gap = 0.75 if category == "occluded" else 1.05
    if any(np.hypot(*(e.centre - outer.centre)) < gap * (e.semi_axes[0] + outer.semi_axes[0]) for e in others):
        return []
    contrast = rng.uniform(9, 16) if category == "low_contrast" else rng.uniform(25, 120)
    ring = [outer]
    while category in ("concentric", "occluded", "complete") and len(ring) < 5:
        if rng.random() < (0.15 if category == "concentric" else 0.6):
            break
        ring.append(_inner(rng, ring[-1]))
        if ring[-1].semi_axes[1] < 6:
            ring.pop()
            break
    for ellipse in ring:
        _paint(rng, canvas, ellipse, contrast)
    return ring


def _inner(rng: np.random.Generator, outer: Ellipse) -> Ellipse:
    """A concentric or nearly concentric ellipse within another one, from 3 px to half its size smaller."""
    x, y, semi_major, semi_minor, angle = outer.geometric
    minor = semi_minor - max(3.5, semi_minor * rng.uniform(0.04, 0.5))
    shift = rng.uniform(-0.02, 0.02, 2) * minor if rng.random() < 0.5 else np.zeros(2)
    minor = max(minor, 1.0)
    return Ellipse.from_geometric(x + shift[0], y + shift[1], minor * semi_major / semi_minor, minor, angle)


def _paint(rng: np.random.Generator, canvas: Array, ellipse: Ellipse, contrast: float) -> None:
    """Fill with a grey that differs by the contrast from what is there; flat, shaded, textured or an outline."""
    x, y = np.clip(np.round(ellipse.centre).astype(int), 0, np.array(canvas.shape[::-1]) - 1)
    outline = np.clip(np.round(ellipse.sample(32)).astype(int), 0, np.array(canvas.shape[::-1]) - 1)
    around = float(np.median(canvas[outline[:, 1], outline[:, 0]]))
    sign = 1 if around < 60 or (around < 195 and rng.random() < 0.5) else -1
    grey: float | Array = float(np.clip(around + sign * contrast, 0, 255))
    kind = rng.random()
    if kind < 0.25 and contrast > 20:
        ys, xs = np.mgrid[0 : canvas.shape[0], 0 : canvas.shape[1]]
        slope = rng.uniform(-0.3, 0.3, 2) * contrast / ellipse.semi_axes[0]
        grey = np.clip(grey + slope[0] * (xs - x) + slope[1] * (ys - y), 0, 255)
    elif kind < 0.4 and contrast > 20:
        grey = np.clip(grey + _texture(rng, (canvas.shape[0], canvas.shape[1]), contrast / 8), 0, 255)
    fill_ellipse(canvas, ellipse, grey)


def _visible_shares(canvas: Array, ellipse: Ellipse) -> tuple[float, float]:
    """Shares of the circumference across which the clean drawing changes plainly, and at least faintly."""
    step = np.abs(steps_across(canvas, ellipse))
    return float(np.mean(step >= VISIBLE_CONTRAST)), float(np.mean(step >= FAINT_CONTRAST))
