"""Public ellipse detectors as a yardstick: those of OpenCV's extra modules, with their default settings.

The extra modules are no dependency of the project. They come with opencv-contrib-python-headless, which replaces
OpenCV as a whole and is therefore best installed into a folder of its own::

    pip install --no-deps --target FOLDER opencv-contrib-python-headless
    PYTHONPATH=FOLDER python -m benchmark.detector.evaluate --against edge_drawing find_ellipses
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError, ResourceError

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

Detector = Callable[[Gray], Array]
"""From (H, W) grey levels to (N, 5): centre x, y, semi-major, semi-minor, angle from x towards y in radians."""


def public_detector(name: str) -> Detector:
    """A public detector by its name, one of ``PUBLIC``.

    Raises:
        InputError: for an unknown name.
        ResourceError: when OpenCV comes without its extra modules.
    """
    if name not in PUBLIC:
        raise InputError("public detector", got=name, expected=f"one of {', '.join(PUBLIC)}")
    _extra_modules()
    return PUBLIC[name]


def _extra_modules() -> Any:
    """OpenCV's module ``ximgproc``, of which the usual package and its type stubs know nothing."""
    modules = getattr(cv2, "ximgproc", None)
    if modules is None:
        raise ResourceError(
            f"public detectors: got OpenCV {cv2.__version__} without its extra modules; expected cv2.ximgproc. "
            "Run `pip install --no-deps --target FOLDER opencv-contrib-python-headless` and set PYTHONPATH=FOLDER"
        )
    return modules


def edge_drawing(gray: Gray) -> Array:
    """Circles and ellipses of Edge Drawing (Akinlar and Topal's EDCircles)."""
    drawing = _extra_modules().createEdgeDrawing()
    drawing.detectEdges(gray)
    return from_edge_drawing(drawing.detectEllipses())


def find_ellipses(gray: Gray) -> Array:
    """Ellipses by projective invariant pruning (Jia et al., 2017)."""
    return from_find_ellipses(_extra_modules().findEllipses(gray))


def from_edge_drawing(rows: NDArray[np.floating] | None) -> Array:
    """(N, 5) ellipses from the rows x, y, radius, axis, other axis, degrees, where a circle has the radius alone."""
    if rows is None:
        return np.empty((0, 5))
    x, y, radius, a, b, degrees = np.asarray(rows, np.float64).reshape(-1, 6).T
    return _ordered(x, y, radius + a, radius + b, np.radians(degrees))


def from_find_ellipses(rows: NDArray[np.floating] | None) -> Array:
    """(N, 5) ellipses from the rows x, y, axis, other axis, score, radians."""
    if rows is None:
        return np.empty((0, 5))
    x, y, a, b, _, angle = np.asarray(rows, np.float64).reshape(-1, 6).T
    return _ordered(x, y, a, b, angle)


def _ordered(x: Array, y: Array, a: Array, b: Array, angle: Array) -> Array:
    """Rows with the longer semi-axis first; the angle given is that of ``a``. Degenerate rows are dropped."""
    rows = np.column_stack([x, y, np.maximum(a, b), np.minimum(a, b), angle + np.where(a >= b, 0.0, np.pi / 2)])
    return np.asarray(rows[np.isfinite(rows).all(axis=1) & (rows[:, 3] > 0)])


PUBLIC: dict[str, Detector] = {"edge_drawing": edge_drawing, "find_ellipses": find_ellipses}
