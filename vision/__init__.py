"""From images to poses: edges, ellipses, matching. Knows nothing of simulators or robots.

The names below are imported when they are first used: ``import vision.errors`` must not load OpenCV and Numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from vision import kernel_cache

if TYPE_CHECKING:
    from vision.detector import detect_ellipses, find_ellipses
    from vision.edges import EdgeMap, EdgeParameters, detect_edges
    from vision.grouping import Grouping, GroupingParameters, group_edges, group_ellipses

kernel_cache.settle()  # before any module with kernels is imported

__all__ = [
    "EdgeMap",
    "EdgeParameters",
    "Grouping",
    "GroupingParameters",
    "detect_edges",
    "detect_ellipses",
    "find_ellipses",
    "group_edges",
    "group_ellipses",
]

_HOME = {
    "EdgeMap": "vision.edges",
    "EdgeParameters": "vision.edges",
    "Grouping": "vision.grouping",
    "GroupingParameters": "vision.grouping",
    "detect_edges": "vision.edges",
    "detect_ellipses": "vision.detector",
    "find_ellipses": "vision.detector",
    "group_edges": "vision.grouping",
    "group_ellipses": "vision.grouping",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
