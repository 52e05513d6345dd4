"""Edges of Sections 5.1 and 5.2: Canny, sub-pixel localisation, and linking into directed chains of points.

Every chain runs so that the brighter side is to the left of someone walking along it with y pointing down
(the tangent is the gradient turned by +90 degrees from x towards y). Where edges meet in a T, the walk goes
straight through and the stem of the T ends there; short gaps, such as Canny leaves at junctions, are bridged.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.errors import InputError

Array = NDArray[np.float64]

# The image is smoothed in 16-bit integers; this gain keeps the fraction that rounding to grey levels would lose.
# 16 * 255 * 4 (the gain of Sobel) stays inside int16.
_FIXED_POINT = 16
_SOBEL_GAIN = 8.0  # response of the 3x3 Sobel operator to a ramp of one grey level per pixel


@dataclass(frozen=True)
class EdgeParameters:
    """How edges are found.

    Attributes:
        smoothing_px: standard deviation of the Gaussian before differentiation.
        gradient_quantile: share of pixels whose gradient lies below Canny's upper threshold, before the two limits.
        min_contrast: lower limit of the upper threshold, grey levels per pixel.
        max_contrast: upper limit of the upper threshold, grey levels per pixel.
        hysteresis: Canny's lower threshold over the upper one.
        min_length_px: chains with fewer points are dropped.
        max_gap_px: gaps up to this length are bridged along the tangent.
    """

    smoothing_px: float = 1.0
    gradient_quantile: float = 0.8
    min_contrast: float = 2.5
    max_contrast: float = 8.0
    hysteresis: float = 0.65
    min_length_px: int = 8
    max_gap_px: int = 3

    def __post_init__(self) -> None:
        numbers = np.array([self.smoothing_px, self.min_contrast, self.max_contrast, self.hysteresis])
        if not np.isfinite(numbers).all() or numbers.min() <= 0 or self.min_contrast > self.max_contrast:
            raise InputError("edge parameters", got=self, expected="positive numbers, min_contrast <= max_contrast")
        if self.hysteresis > 1 or not 0 <= self.gradient_quantile <= 1:
            raise InputError("edge parameters", got=self, expected="hysteresis and gradient_quantile up to 1")

    @property
    def total_smoothing_px(self) -> float:
        """Standard deviation of the Gaussian together with the Sobel operator (variance 1/2 across its mask)."""
        return float(np.sqrt(self.smoothing_px**2 + 0.5))


@dataclass(frozen=True, eq=False)
class EdgeMap:
    """Chains of sub-pixel edge points of one image.

    Attributes:
        points: (N, 2) sub-pixel positions x, y of all chains, one chain after the other, in walking order.
        gradients: (N, 2) unit gradient (towards brighter) at each point.
        magnitudes: (N,) gradient magnitude, grey levels per pixel.
        offsets: (C + 1,) chain c consists of the points ``offsets[c]:offsets[c + 1]``.
        closed: (C,) True where the end of a chain meets its beginning.
        index: (H, W) int32, the number of the point that lies in a pixel, or -1.
    """

    points: Array
    gradients: Array
    magnitudes: Array
    offsets: NDArray[np.int64]
    closed: NDArray[np.bool_]
    index: NDArray[np.int32]

    def __post_init__(self) -> None:
        for name in ("points", "gradients", "magnitudes", "offsets", "closed", "index"):
            array = np.ascontiguousarray(getattr(self, name)).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the arrays stay read-only."""
        return (EdgeMap, (self.points, self.gradients, self.magnitudes, self.offsets, self.closed, self.index))

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def chain(self, number: int) -> Array:
        """(n, 2) points of one chain."""
        return self.points[self.offsets[number] : self.offsets[number + 1]]

    @property
    def endpoints(self) -> Array:
        """(C, 2, 2) first and last point of every chain."""
        return np.stack([self.points[self.offsets[:-1]], self.points[self.offsets[1:] - 1]], axis=1)

    @property
    def mask(self) -> NDArray[np.uint8]:
        """(H, W) 255 on edge pixels, else 0."""
        return np.where(self.index >= 0, 255, 0).astype(np.uint8)


def as_gray(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """The image as (H, W) uint8 grey levels.

    Args:
        image: (H, W) grey or (H, W, 3) RGB, (H, W, 4) RGBA, or (H, W, 1); uint8, bool, or numbers from 0 to 255.

    Raises:
        InputError: for other shapes, other kinds of numbers, NaN, and numbers outside 0 to 255.
    """
    array = np.asarray(image)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[:, :, 0]
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise InputError("image", got=f"shape {array.shape}", expected="(H, W) grey, (H, W, 3) RGB or (H, W, 4) RGBA")
    if array.dtype == np.bool_:
        array = array.astype(np.uint8) * np.uint8(255)
    if array.dtype != np.uint8:
        array = _to_uint8(array)
    if array.ndim == 2:
        return np.ascontiguousarray(array)
    if array.size == 0:
        return np.zeros(array.shape[:2], np.uint8)
    code = cv2.COLOR_RGB2GRAY if array.shape[2] == 3 else cv2.COLOR_RGBA2GRAY
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(array), code), dtype=np.uint8)


def _to_uint8(array: NDArray[np.generic]) -> NDArray[np.uint8]:
    if array.dtype.kind not in "iuf":
        raise InputError("image", got=f"dtype {array.dtype}", expected="uint8 grey levels")
    numbers = array.astype(np.float64)
    if not np.isfinite(numbers).all():
        raise InputError("image", got="NaN or infinite values", expected="finite grey levels from 0 to 255")
    if numbers.size and (numbers.min() < 0 or numbers.max() > 255):
        raise InputError(
            "image",
            got=f"values from {numbers.min():g} to {numbers.max():g}",
            expected="grey levels from 0 to 255",
            do="Scale the image first",
        )
    return np.round(numbers).astype(np.uint8)


def detect_edges(gray: NDArray[np.generic], parameters: EdgeParameters | None = None) -> EdgeMap:
    """Find edges and link them into chains.

    Args:
        gray: (H, W) uint8 image (colour is converted, see :func:`as_gray`).
        parameters: thresholds.

    Raises:
        InputError: see :func:`as_gray`.
    """
    parameters = parameters or EdgeParameters()
    image = as_gray(gray)
    if min(image.shape) < 3:
        return _empty(image.shape)
    gx, gy = image_gradients(image, parameters.smoothing_px)
    high = _upper_threshold(gx, gy, parameters)
    pixels = cv2.Canny(gx, gy, high * parameters.hysteresis, high, L2gradient=True)
    order, offsets, closed = _link(np.asarray(pixels), gx, gy, parameters.min_length_px, parameters.max_gap_px)
    points, gradients, magnitudes = _localise(order, gx, gy)
    index = np.full(image.shape, -1, np.int32)
    index.ravel()[order] = np.arange(len(order), dtype=np.int32)
    magnitudes /= _SOBEL_GAIN * _FIXED_POINT
    return EdgeMap(points, gradients, magnitudes, offsets, closed, index)


def image_gradients(image: NDArray[np.uint8], smoothing_px: float) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Sobel gradients (int16, fixed point) of the image smoothed with a Gaussian."""
    scaled = cv2.multiply(image, _FIXED_POINT, dtype=cv2.CV_16S)
    smooth = cv2.GaussianBlur(scaled, (0, 0), smoothing_px, borderType=cv2.BORDER_REPLICATE)
    gx = cv2.Sobel(smooth, cv2.CV_16S, 1, 0, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Sobel(smooth, cv2.CV_16S, 0, 1, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(gx), np.asarray(gy)


def _upper_threshold(gx: NDArray[np.int16], gy: NDArray[np.int16], parameters: EdgeParameters) -> float:
    """Canny's upper threshold: a quantile of the gradient, between limits, in the units of gx and gy."""
    sample = np.hypot(gx[::3, ::3].astype(np.float32), gy[::3, ::3].astype(np.float32)).ravel()
    rank = min(int(parameters.gradient_quantile * len(sample)), len(sample) - 1)
    unit = _SOBEL_GAIN * _FIXED_POINT
    quantile = np.partition(sample, rank)[rank] / unit
    return float(np.clip(quantile, parameters.min_contrast, parameters.max_contrast) * unit)


def _empty(shape: tuple[int, ...]) -> EdgeMap:
    none = np.zeros((0, 2))
    index = np.full(shape, -1, np.int32)
    return EdgeMap(none, none, np.zeros(0), np.zeros(1, np.int64), np.zeros(0, bool), index)


@njit(cache=True)
def _next_pixel(free, gx, gy, x, y, sign, max_gap):  # type: ignore[no-untyped-def]
    """The free edge pixel that continues the walk from (x, y), or (-1, -1).

    The 8 neighbours come first; without one, pixels further ahead along the tangent, for gaps.
    """
    height, width = free.shape
    g0x, g0y = float(gx[y, x]), float(gy[y, x])
    norm0 = max(np.sqrt(g0x * g0x + g0y * g0y), 1e-9)
    tx, ty = -sign * g0y / norm0, sign * g0x / norm0
    best, bx, by = 0.0, -1, -1
    for reach in range(1, max_gap + 2):
        # In a gap the two ends must agree much better than neighbours need to.
        min_ahead, min_agreement = (0.2, 0.5) if reach == 1 else (0.85, 0.85)
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if max(abs(dx), abs(dy)) != reach:
                    continue
                nx, ny = x + dx, y + dy
                if nx < 0 or ny < 0 or nx >= width or ny >= height or not free[ny, nx]:
                    continue
                ahead = (dx * tx + dy * ty) / np.sqrt(float(dx * dx + dy * dy))
                if ahead < min_ahead:
                    continue
                hx, hy = float(gx[ny, nx]), float(gy[ny, nx])
                agreement = (hx * g0x + hy * g0y) / (norm0 * max(np.sqrt(hx * hx + hy * hy), 1e-9))
                if agreement < min_agreement:
                    continue
                if ahead + agreement > best:
                    best, bx, by = ahead + agreement, nx, ny
        if bx >= 0:
            break
    return bx, by


@njit(cache=True)
def _walk(free, gx, gy, x, y, sign, max_gap, out, count, begin):  # type: ignore[no-untyped-def]
    """Follow the edge from (x, y) along sign * tangent; append pixel numbers to out, return the new count.

    The chain so far lies in out[begin:count].
    """
    width = free.shape[1]
    while True:
        # Only what has some length may reach across a gap; specks of texture may not.
        nx, ny = _next_pixel(free, gx, gy, x, y, sign, max_gap if count - begin >= 4 else 0)
        if nx < 0:
            return count
        if abs(nx - x) == 1 and abs(ny - y) == 1:  # the inner corner of a stair belongs to this step
            free[y, nx] = free[ny, x] = False
        x, y = nx, ny
        free[y, x] = False
        out[count] = y * width + x
        count += 1


@njit(cache=True)
def _link(pixels, gx, gy, min_length, max_gap):  # type: ignore[no-untyped-def]
    """Link edge pixels into chains: pixel numbers in walking order, chain offsets, closed flags."""
    width = pixels.shape[1]
    free = pixels > 0
    starts = np.flatnonzero(free)
    total = len(starts)
    order = np.empty(total, np.int64)
    buffer = np.empty(total, np.int64)
    offsets = [0]
    closed = [False]
    n = 0
    for start in starts:
        y, x = start // width, start % width
        if not free[y, x]:
            continue
        free[y, x] = False
        backward = _walk(free, gx, gy, x, y, -1.0, max_gap, buffer, 0, 0)
        first = n
        for k in range(backward):
            order[n + k] = buffer[backward - 1 - k]
        n += backward
        order[n] = start
        n = _walk(free, gx, gy, x, y, 1.0, max_gap, order, n + 1, first)
        if n - first < min_length:
            n = first
            continue
        head, tail = order[first], order[n - 1]
        gap = max(abs(head // width - tail // width), abs(head % width - tail % width))
        offsets.append(n)
        closed.append(gap <= max_gap + 1 and n - first >= 16)
    return order[:n].copy(), np.array(offsets), np.array(closed)[1:]


@njit(cache=True)
def _magnitude_at(gx, gy, x, y):  # type: ignore[no-untyped-def]
    """Gradient magnitude at a sub-pixel place, bilinear."""
    height, width = gx.shape
    x0 = min(max(int(np.floor(x)), 0), width - 2)
    y0 = min(max(int(np.floor(y)), 0), height - 2)
    fx, fy = x - x0, y - y0
    value = 0.0
    for dy in range(2):
        for dx in range(2):
            weight = (fx if dx else 1 - fx) * (fy if dy else 1 - fy)
            a, b = float(gx[y0 + dy, x0 + dx]), float(gy[y0 + dy, x0 + dx])
            value += weight * np.sqrt(a * a + b * b)
    return value


@njit(cache=True)
def _localise(order, gx, gy):  # type: ignore[no-untyped-def]
    """Sub-pixel points: the vertex of a parabola through the gradient magnitude along the gradient."""
    width = gx.shape[1]
    n = len(order)
    points, gradients, magnitudes = np.empty((n, 2)), np.empty((n, 2)), np.empty(n)
    for k in range(n):
        y, x = order[k] // width, order[k] % width
        a, b = float(gx[y, x]), float(gy[y, x])
        middle = max(np.sqrt(a * a + b * b), 1e-9)
        ux, uy = a / middle, b / middle
        before = _magnitude_at(gx, gy, x - ux, y - uy)
        after = _magnitude_at(gx, gy, x + ux, y + uy)
        bend = before - 2 * middle + after
        shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
        shift = min(max(shift, -0.75), 0.75)
        points[k, 0], points[k, 1] = x + shift * ux, y + shift * uy
        gradients[k, 0], gradients[k, 1] = ux, uy
        magnitudes[k] = middle
    return points, gradients, magnitudes
