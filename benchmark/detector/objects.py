"""Things with elliptic outlines as photographs show them: plates, cups, wheels, signs, coins, balls, lamps.

Every thing is painted onto a `Picture`, which remembers for each pixel the thing on top, so that afterwards it is
known how much of each outline can be seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from benchmark.detector.surfaces import Texture, letters_without_rings, textured
from vision.geometry.ellipse import Ellipse

Array = NDArray[np.float64]

_MIN_SEMI_MINOR_PX = 6.0
_VISIBLE_CONTRAST = 10.0  # grey levels
_FAINT_CONTRAST = 2.5  # grey levels: some see such an outline, and some do not
NOBODY = 0


@dataclass(eq=False)
class Picture:
    """A picture in the making.

    Attributes:
        canvas: (H, W) grey levels.
        owner: (H, W) number of the thing on top, 0 for the background.
        texture: of the surfaces.
        outlines: the elliptic outlines and the numbers of their things.
        unasked: outlines that nobody asks for and nobody minds, such as those of shadows.
        things: how many things there are.
    """

    canvas: Array
    owner: NDArray[np.int32]
    texture: Texture
    outlines: list[tuple[Ellipse, int]] = field(default_factory=list)
    unasked: list[Ellipse] = field(default_factory=list)
    things: int = 0

    @classmethod
    def on(cls, canvas: Array, texture: Texture) -> Picture:
        """An empty picture on a background."""
        return cls(canvas, np.zeros(canvas.shape, np.int32), texture)

    def surface(self, rng: np.random.Generator, grey: float, amplitude: float) -> Array:
        """(H, W) grey levels to paint with: a mean, a gradient, and texture of an amplitude."""
        return textured(rng, self.canvas.shape, grey, amplitude, self.texture)

    def new_thing(self) -> int:
        """The number of the next thing."""
        self.things += 1
        return self.things

    def paint(self, cover: Array, grey: float | Array, number: int) -> None:
        """Paint with an opacity (H, W) from 0 to 1 and remember the owner where it is opaque."""
        self.canvas += cover * (grey - self.canvas)
        self.owner[cover > 0.5] = number

    def visible_shares(self, outline: Ellipse, number: int) -> tuple[float, float]:
        """Share of an outline that lies in the picture, is not hidden, and has contrast on average over a stretch.

        First the share with a contrast that everyone sees, then that with a faint one.
        """
        points = outline.sample(256)
        outward = np.column_stack([points, np.ones(256)]) @ outline.conic[:, :2]
        outward /= np.hypot(*outward.T)[:, None]
        limit = np.array(self.canvas.shape[::-1]) - 1
        sides = [np.round(points + step * outward).astype(int) for step in (-2.0, 2.0)]
        seen = np.all([(side >= 0).all(axis=1) & (side <= limit).all(axis=1) for side in sides], axis=0)
        inner, outer = (tuple(np.clip(side, 0, limit).T[::-1]) for side in sides)
        step = uniform_filter1d(self.canvas[inner] - self.canvas[outer], 15, mode="wrap")
        seen &= self.owner[inner] == number
        visible, faint = (float(np.mean(seen & (np.abs(step) >= c))) for c in (_VISIBLE_CONTRAST, _FAINT_CONTRAST))
        return visible, faint


def distance_map(shape: tuple[int, ...], outline: Ellipse) -> Array:
    """(H, W) signed distance of every pixel to an ellipse, to first order, positive outside."""
    ys, xs = np.mgrid[0 : shape[0], 0 : shape[1]].astype(float)
    return outline.distance(np.column_stack([xs.ravel(), ys.ravel()])).reshape(shape)


def scaled(outline: Ellipse, factor: float, shift: Array | None = None) -> Ellipse:
    """An ellipse of the same shape, smaller or larger, and set off by ``shift`` pixels."""
    x, y, semi_major, semi_minor, angle = outline.geometric
    dx, dy = (0.0, 0.0) if shift is None else shift
    return Ellipse.from_geometric(x + dx, y + dy, semi_major * factor, semi_minor * factor, angle)


def random_outline(
    rng: np.random.Generator,
    shape: tuple[int, ...],
    size_px: tuple[float, float],
    ratio: tuple[float, float],
    cut: bool,
) -> Ellipse:
    """An ellipse somewhere; with ``cut`` its centre lies near a border of the image."""
    height, width = shape[:2]
    semi_major = float(np.exp(rng.uniform(*np.log(size_px))))
    semi_minor = max(semi_major * rng.uniform(*ratio), min(_MIN_SEMI_MINOR_PX, semi_major))
    centre = rng.uniform(0, 1, 2) * (width, height)
    if cut:
        axis = int(rng.integers(2))
        centre[axis] = (width, height)[axis] * rng.integers(2)
        centre[axis] += (1 if centre[axis] == 0 else -1) * rng.uniform(0.1, 0.9) * semi_minor
    return Ellipse.from_geometric(centre[0], centre[1], semi_major, semi_minor, rng.uniform(0, np.pi))


def _shadow(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A soft dark copy, set off and blurred, beneath a thing."""
    semi_minor = outline.semi_axes[1]
    dark = scaled(outline, rng.uniform(0.95, 1.1), rng.uniform(-0.25, 0.25, 2) * semi_minor)
    softness = rng.uniform(0.05, 0.3) * semi_minor + 1
    picture.unasked.append(dark)
    cover = 1 / (1 + np.exp(np.clip(distance_map(picture.canvas.shape, dark) / softness * 2, -30, 30)))
    picture.canvas *= 1 - rng.uniform(0.2, 0.6) * cover


def _disc(
    rng: np.random.Generator, picture: Picture, outline: Ellipse, grey: float, number: int, softness_px: float = 0.5
) -> None:
    """A filled ellipse, shaded and textured, with a contour that is soft over a few pixels."""
    distance = distance_map(picture.canvas.shape, outline)
    cover = np.clip(0.5 - distance / (2 * softness_px), 0, 1)
    surface = picture.surface(rng, grey, float(rng.choice([1.0, 4.0, 12.0])))
    picture.paint(cover, surface, number)
    picture.outlines.append((outline, number))


def _differing(rng: np.random.Generator, grey: float, least: float = 25.0) -> float:
    """A grey level that differs from another one."""
    other = grey + rng.choice([-1, 1]) * rng.uniform(least, 120)
    return float(other if 5 <= other <= 250 else np.clip(2 * grey - other, 5, 250))


def _local_grey(picture: Picture, outline: Ellipse) -> float:
    limit = np.array(picture.canvas.shape[::-1]) - 1
    points = np.clip(np.round(outline.sample(48)).astype(int), 0, limit)
    return float(np.median(picture.canvas[points[:, 1], points[:, 0]]))


def _plate(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """Rings with a depth: concentric in space, shifted in the picture."""
    number = picture.new_thing()
    grey = _differing(rng, _local_grey(picture, outline))
    _disc(rng, picture, outline, grey, number)
    factor = 1.0
    for _ in range(int(rng.integers(1, 4))):
        factor *= rng.uniform(0.55, 0.93)
        inner = scaled(outline, factor, rng.uniform(-0.04, 0.04, 2) * outline.semi_axes[1])
        if inner.semi_axes[1] < _MIN_SEMI_MINOR_PX:
            break
        grey = _differing(rng, grey, 12)
        _disc(rng, picture, inner, grey, number)


def _cup(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A body with straight sides that run tangentially into a rim of some thickness."""
    number = picture.new_thing()
    x, y, semi_major, semi_minor, _ = outline.geometric
    outline = Ellipse.from_geometric(x, y, semi_major, min(semi_minor, 0.8 * semi_major), rng.uniform(-0.15, 0.15))
    body = _differing(rng, _local_grey(picture, outline))
    depth, taper = rng.uniform(0.6, 1.8) * semi_major, rng.uniform(0.7, 1.0)
    foot = scaled(outline, taper, np.array([0.0, depth]))
    hull = cv2.convexHull(np.vstack([outline.sample(80), foot.sample(80)]).astype(np.float32))
    mask = np.zeros(picture.canvas.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(hull * 16).astype(np.int32), 255, cv2.LINE_AA, 4)
    picture.paint(mask / 255.0, picture.surface(rng, body, 4.0), number)
    picture.unasked.append(foot)  # of which the nearer half can be seen
    _disc(rng, picture, outline, _differing(rng, body, 15), number)
    inner = scaled(outline, rng.uniform(0.82, 0.95))
    _disc(rng, picture, inner, _differing(rng, body, 25), number)


def _wheel(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A dark tyre, a bright rim with spokes, and a hub."""
    number = picture.new_thing()
    _disc(rng, picture, outline, rng.uniform(10, 60), number)
    rim = scaled(outline, rng.uniform(0.6, 0.8))
    if rim.semi_axes[1] < _MIN_SEMI_MINOR_PX:
        return
    _disc(rng, picture, rim, rng.uniform(110, 230), number)
    mask = np.zeros(picture.canvas.shape, np.uint8)
    spokes = rim.sample(int(rng.integers(4, 14)))
    for point in spokes:
        ends = [tuple(np.round(p * 16).astype(int).tolist()) for p in (rim.centre, rim.centre * 0.08 + point * 0.92)]
        cv2.line(mask, ends[0], ends[1], 255, max(1, int(0.08 * rim.semi_axes[1])), cv2.LINE_AA, 4)
    picture.paint(mask / 255.0, rng.uniform(10, 80), number)
    hub = scaled(rim, rng.uniform(0.2, 0.35))
    if hub.semi_axes[1] >= _MIN_SEMI_MINOR_PX:
        _disc(rng, picture, hub, rng.uniform(120, 230), number)


def _sign(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A round sign with a border and letters."""
    number = picture.new_thing()
    grey = _differing(rng, _local_grey(picture, outline))
    _disc(rng, picture, outline, grey, number)
    field_grey = _differing(rng, grey, 30)
    inner = scaled(outline, rng.uniform(0.72, 0.9))
    if inner.semi_axes[1] < _MIN_SEMI_MINOR_PX:
        return
    _disc(rng, picture, inner, field_grey, number)
    mask = np.zeros(picture.canvas.shape, np.uint8)
    size = inner.semi_axes[1] / 40
    at = inner.centre + inner.semi_axes[1] * np.array([-0.6, 0.3])
    text = letters_without_rings(rng.integers(48, 91, 2))
    cv2.putText(
        mask,
        text,
        tuple(at.astype(int).tolist()),
        cv2.FONT_HERSHEY_SIMPLEX,
        size,
        255,
        max(1, int(4 * size)),
        cv2.LINE_AA,
    )
    picture.paint(mask / 255.0, _differing(rng, field_grey, 40), number)


def _coin(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A disc with strong relief, darker or brighter than what is around it only on the average."""
    number = picture.new_thing()
    cover = np.clip(0.5 - distance_map(picture.canvas.shape, outline), 0, 1)
    grey = _differing(rng, _local_grey(picture, outline), 20)
    picture.paint(cover, picture.surface(rng, grey, rng.uniform(10, 30)), number)
    picture.outlines.append((outline, number))


def _ball(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A round body lit from one side, with a highlight."""
    number = picture.new_thing()
    semi_major, semi_minor = outline.semi_axes
    distance = distance_map(picture.canvas.shape, outline)
    depth = np.sqrt(np.clip(-distance / semi_minor, 0, 1) * (2 - np.clip(-distance / semi_minor, 0, 1)))
    ys, xs = np.mgrid[0 : distance.shape[0], 0 : distance.shape[1]]
    light = rng.normal(size=2)
    light /= np.hypot(*light)
    across = ((xs - outline.centre[0]) * light[0] + (ys - outline.centre[1]) * light[1]) / semi_major
    albedo = _differing(rng, _local_grey(picture, outline), 30)
    grey = albedo * np.clip(0.75 + 0.25 * depth + rng.uniform(0.1, 0.4) * across, 0.2, 1.3)
    picture.paint(np.clip(0.5 - distance, 0, 1), np.clip(grey, 0, 255), number)
    picture.outlines.append((outline, number))
    shine = scaled(outline, rng.uniform(0.08, 0.2), light * 0.4 * semi_minor)
    glow = np.clip(0.5 - distance_map(distance.shape, shine) / 4, 0, 1)
    picture.canvas += glow * (245 - picture.canvas) * rng.uniform(0, 1)


def _lamp(rng: np.random.Generator, picture: Picture, outline: Ellipse) -> None:
    """A disc with a contour that is soft over several pixels, as things out of focus have."""
    number = picture.new_thing()
    grey = _differing(rng, _local_grey(picture, outline), 40)
    softness = rng.uniform(1.0, min(5.0, 0.15 * outline.semi_axes[1] + 1.0))
    _disc(rng, picture, outline, grey, number, softness)


KINDS: tuple[Callable[[np.random.Generator, Picture, Ellipse], None], ...] = (
    _plate, _cup, _wheel, _sign, _coin, _ball, _lamp,
)  # fmt: skip


def add_object(rng: np.random.Generator, picture: Picture, outline: Ellipse, soft: bool = False) -> None:
    """Paint one thing of a random kind, often with its shadow; ``soft`` asks for a soft contour."""
    if rng.random() < 0.5:
        _shadow(rng, picture, outline)
    kind = _lamp if soft else KINDS[int(rng.integers(len(KINDS)))]
    kind(rng, picture, outline)
    np.clip(picture.canvas, 0, 255, out=picture.canvas)
