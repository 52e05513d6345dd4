"""From images to poses: edges, ellipses, matching. Knows nothing of simulators or robots.

The names below are imported when they are first used: ``import vision`` must not load OpenCV and Numba.
``docs/vision.md`` shows how they work together.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from vision import kernel_cache

if TYPE_CHECKING:
    from vision.camera import Camera, View
    from vision.candidates import Workspace
    from vision.circle_pose import Circle
    from vision.detector import detect_ellipses, find_ellipses
    from vision.edges import EdgeMap, EdgeParameters, detect_edges
    from vision.ellipse import Ellipse
    from vision.ellipse_filter import FilterParameters
    from vision.errors import FileFormatError, FocalpickError, InputError, ResourceError
    from vision.extraction_thresholds import ExtractionThresholds
    from vision.features import EllipseFeature, RegionAttributes
    from vision.fragments import FragmentParameters
    from vision.grouping import Grouping, GroupingParameters, group_edges, group_ellipses
    from vision.localizer import EllipseLocalizer, Localization, Localizer, extract_features
    from vision.matching_parameters import MatchingParameters
    from vision.model_file import load_model, save_model
    from vision.picture import read_picture
    from vision.pose import PoseEstimate
    from vision.quadtree import SplitAndMerge
    from vision.region_attributes import AttributeConstraints
    from vision.regions import BoundaryFit, region_ellipses
    from vision.segmentation import Region, RegionGrowing, Segmentation, segment
    from vision.superimposition import superimpose
    from vision.view_directory import load_views, save_views
    from vision.vision_model import CircleFeature, VisionModel

kernel_cache.settle()  # before any module with kernels is imported

__all__ = [
    "AttributeConstraints",
    "BoundaryFit",
    "Camera",
    "Circle",
    "CircleFeature",
    "EdgeMap",
    "EdgeParameters",
    "Ellipse",
    "EllipseFeature",
    "EllipseLocalizer",
    "ExtractionThresholds",
    "FileFormatError",
    "FilterParameters",
    "FocalpickError",
    "FragmentParameters",
    "Grouping",
    "GroupingParameters",
    "InputError",
    "Localization",
    "Localizer",
    "MatchingParameters",
    "PoseEstimate",
    "Region",
    "RegionAttributes",
    "RegionGrowing",
    "ResourceError",
    "Segmentation",
    "SplitAndMerge",
    "View",
    "VisionModel",
    "Workspace",
    "detect_edges",
    "detect_ellipses",
    "extract_features",
    "find_ellipses",
    "group_edges",
    "group_ellipses",
    "load_model",
    "load_views",
    "read_picture",
    "region_ellipses",
    "save_model",
    "save_views",
    "segment",
    "superimpose",
]

_NAMES = {
    "camera": ("Camera", "View"),
    "candidates": ("Workspace",),
    "circle_pose": ("Circle",),
    "detector": ("detect_ellipses", "find_ellipses"),
    "edges": ("EdgeMap", "EdgeParameters", "detect_edges"),
    "ellipse": ("Ellipse",),
    "ellipse_filter": ("FilterParameters",),
    "errors": ("FileFormatError", "FocalpickError", "InputError", "ResourceError"),
    "extraction_thresholds": ("ExtractionThresholds",),
    "features": ("EllipseFeature", "RegionAttributes"),
    "fragments": ("FragmentParameters",),
    "grouping": ("Grouping", "GroupingParameters", "group_edges", "group_ellipses"),
    "localizer": ("EllipseLocalizer", "Localization", "Localizer", "extract_features"),
    "matching_parameters": ("MatchingParameters",),
    "model_file": ("load_model", "save_model"),
    "picture": ("read_picture",),
    "pose": ("PoseEstimate",),
    "quadtree": ("SplitAndMerge",),
    "region_attributes": ("AttributeConstraints",),
    "regions": ("BoundaryFit", "region_ellipses"),
    "segmentation": ("Region", "RegionGrowing", "Segmentation", "segment"),
    "superimposition": ("superimpose",),
    "view_directory": ("load_views", "save_views"),
    "vision_model": ("CircleFeature", "VisionModel"),
}
_HOME = {name: f"vision.{module}" for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
