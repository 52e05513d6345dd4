"""Edges of Sections 5.1 and 5.2: Canny, sub-pixel localisation, and linking into directed chains of points.

Every chain runs so that the brighter side is to the left of someone walking along it with y pointing down
(the tangent is the gradient turned by +90 degrees from x towards y). Where edges meet in a T, the walk goes
straight through and the stem of the T ends there; short gaps, such as Canny leaves at junctions, are bridged.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edges.chains import link_pixels, localise
from vision.edges.peaks import settle
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.blur import CAMERA_VARIANCE, SOBEL_VARIANCE
from vision.settings import NOT_NEGATIVE, POSITIVE, Allowed, check, count

Array = NDArray[np.float64]

# The image is smoothed in 16-bit integers; this gain keeps the fraction that rounding to grey levels would lose.
# 16 * 255 * 4 (the gain of Sobel) stays inside int16.
_FIXED_POINT = 16
GRADIENT_UNIT = 8.0 * _FIXED_POINT  # of a ramp of one grey level per pixel; 8 is the gain of the 3x3 Sobel operator
_UNIT = 256.0  # Canny's upper threshold, in gradients divided by the local threshold
_STRIDE = 4  # of the pixels from which local thresholds are computed
_MAX_STRONG_SHARE = 0.2  # of the image: where more of it is above the upper limit of the threshold, the limit rises


@dataclass(frozen=True)
class EdgeParameters:
    """How edges are found.

    Attributes:
        smoothing_px: standard deviation of the Gaussian before differentiation.
        noise_factor: Canny's upper threshold is at least this times the gradient that 30 % of the image stay below.
        clutter_factor: and at least this many times the mean gradient of the neighbourhood.
        window_px: width of that neighbourhood.
        min_contrast: lower limit of the upper threshold, grey levels per pixel.
        max_contrast: upper limit of the upper threshold, grey levels per pixel; more where a fifth of the image
            exceeds it, which bounds the time in texture.
        hysteresis: Canny's lower threshold over the upper one.
        min_length_px: chains with fewer points are dropped.
        max_gap_px: gaps up to this length are bridged along the tangent.
    """

    smoothing_px: float = 1.0
    noise_factor: float = 4.0
    clutter_factor: float = 1.5
    window_px: float = 60.0
    min_contrast: float = 1.2
    max_contrast: float = 8.0
    hysteresis: float = 0.65
    min_length_px: int = 8
    max_gap_px: int = 3

    def __post_init__(self) -> None:
        check(self, smoothing_px=Allowed(0, 100, above=True), hysteresis=Allowed(0, 1, above=True))
        check(self, window_px=POSITIVE, noise_factor=NOT_NEGATIVE, clutter_factor=NOT_NEGATIVE, min_contrast=POSITIVE)
        check(self, max_contrast=Allowed(self.min_contrast), min_length_px=count(1), max_gap_px=count())

    @property
    def blur_variance(self) -> float:
        """Variance in px² of all that blurs an edge: the Gaussian, the Sobel operator, and a sharp camera."""
        return float(self.smoothing_px**2 + SOBEL_VARIANCE + CAMERA_VARIANCE)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class EdgeMap:
    """Chains of sub-pixel edge points of one image.

    Attributes:
        points: (N, 2) sub-pixel positions x, y of all chains, one chain after the other, in walking order.
        gradients: (N, 2) unit gradient (towards brighter) at each point.
        offsets: (C + 1,) chain c consists of the points ``offsets[c]:offsets[c + 1]``.
        index: (H, W) int32, the number of the point that lies in a pixel, or -1.
        gx: (H, W) int16, gradient of the smoothed image along x, in units of its own.
        gy: the same along y.
    """

    points: Array
    gradients: Array
    offsets: NDArray[np.int64]
    index: NDArray[np.int32]
    gx: NDArray[np.int16]
    gy: NDArray[np.int16]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def chain(self, number: int) -> Array:
        """(n, 2) points of one chain."""
        return self.points[self.offsets[number] : self.offsets[number + 1]]

    def settled(self, numbers: NDArray[np.int64]) -> Array:
        """(n, 2) the points of these numbers, to a hundredth of a pixel.

        The points of all chains are some hundredths off, by the direction of the edge; to read the gradient as it
        takes to be exact is worth the time for the few that form ellipses.
        """
        return np.asarray(settle(self.points[numbers], self.gradients[numbers], self.gx, self.gy))


def as_gray(image: NDArray[np.generic]) -> NDArray[np.uint8]:
    """The image as (H, W) uint8 grey levels.

    Args:
        image: (H, W) grey or (H, W, 3) RGB, (H, W, 4) RGBA, or (H, W, 1); uint8, bool, or numbers from 0 to 255.

    Raises:
        InputError: for other shapes, other kinds of numbers, NaN, numbers outside 0 to 255, and fractions of 1, which
            would all be black.
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
    if array.dtype.kind == "f" and numbers.size and numbers.max() <= 1 and (numbers % 1).any():
        got = f"floating-point values from {numbers.min():g} to {numbers.max():g}"
        raise InputError("image", got=got, expected="grey levels from 0 to 255", do="Give it as image * 255")
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
    pixels = cv2.Canny(*_balance(gx, gy, parameters), _UNIT * parameters.hysteresis, _UNIT, L2gradient=True)
    order, offsets = link_pixels(np.asarray(pixels), gx, gy, parameters.min_length_px, parameters.max_gap_px)
    points, gradients = localise(order, gx, gy)
    index = np.full(image.shape, -1, np.int32)
    index.ravel()[order] = np.arange(len(order), dtype=np.int32)
    return EdgeMap(points, gradients, offsets, index, gx, gy)


def image_gradients(image: NDArray[np.uint8], smoothing_px: float) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Sobel gradients (H, W) along x and y of the image smoothed with a Gaussian, in units of ``GRADIENT_UNIT``."""
    scaled = cv2.multiply(image, _FIXED_POINT, dtype=cv2.CV_16S)
    smooth = cv2.GaussianBlur(scaled, (0, 0), smoothing_px, borderType=cv2.BORDER_REPLICATE)
    gx = cv2.Sobel(smooth, cv2.CV_16S, 1, 0, borderType=cv2.BORDER_REPLICATE)
    gy = cv2.Sobel(smooth, cv2.CV_16S, 0, 1, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(gx), np.asarray(gy)


def _balance(
    gx: NDArray[np.int16], gy: NDArray[np.int16], parameters: EdgeParameters
) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Gradients divided by the local threshold of Canny, so that ``_UNIT`` is the threshold everywhere."""
    height, width = gx.shape
    coarse = cv2.magnitude(gx[::_STRIDE, ::_STRIDE].astype(np.float32), gy[::_STRIDE, ::_STRIDE].astype(np.float32))
    sample = np.sort(coarse, axis=None)
    noise = float(sample[int(0.3 * (sample.size - 1))])
    window = 2 * max(int(parameters.window_px / _STRIDE / 2), 1) + 1
    local = cv2.blur(coarse, (window, window), borderType=cv2.BORDER_REFLECT)
    upper = parameters.max_contrast * GRADIENT_UNIT
    lower = np.clip(parameters.noise_factor * noise, parameters.min_contrast * GRADIENT_UNIT, upper)
    upper = max(upper, float(sample[int((1 - _MAX_STRONG_SHARE) * (sample.size - 1))]))
    threshold = np.clip(parameters.clutter_factor * local, lower, upper)
    gain = cv2.resize(np.asarray(_UNIT / threshold, np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    balanced = [cv2.multiply(g, gain, dtype=cv2.CV_16S) for g in (gx, gy)]
    return np.asarray(balanced[0]), np.asarray(balanced[1])


def _empty(shape: tuple[int, ...]) -> EdgeMap:
    none = np.zeros((0, 2))
    index = np.full(shape, -1, np.int32)
    flat = np.zeros(shape, np.int16)
    return EdgeMap(none, none, np.zeros(1, np.int64), index, flat, flat)
