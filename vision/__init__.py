"""From images to poses: edges, ellipses, matching. Knows nothing of simulators or robots.

The names below are imported when they are first used: ``import vision`` must not load OpenCV and Numba.
``docs/vision.md`` shows how they work together.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from vision import kernel_cache

if TYPE_CHECKING:
    from vision.drawing.superimpose import superimpose
    from vision.edges.edge_map import EdgeMap, EdgeParameters, detect_edges
    from vision.errors import FileFormatError, FocalpickError, InputError, ResourceError
    from vision.extraction import Extraction, ExtractionThresholds
    from vision.features import EllipseFeature, RegionAttributes
    from vision.files.picture import read_picture
    from vision.files.views import load_views, save_views
    from vision.geometry.camera import Camera, View
    from vision.geometry.circle import Circle
    from vision.geometry.ellipse import Ellipse
    from vision.geometry.pose_reading import PoseReading
    from vision.geometry.workspace import Workspace
    from vision.grouping.detector import detect_ellipses, find_ellipses
    from vision.grouping.edge_grouping import Grouping, GroupingParameters, group_edges, group_ellipses
    from vision.grouping.fragments import FragmentParameters
    from vision.grouping.kalman_filter import FilterParameters
    from vision.localizer import EllipseLocalizer, Localization, Localizer, extract_features
    from vision.matching.parameters import MatchingParameters
    from vision.matching.pose_check import PoseCheck, check_poses
    from vision.model.grasp import BoreCoordinates, GraspCoordinates
    from vision.model.model_file import load_model, save_model
    from vision.model.vision_model import AttributeRange, CircleFeature, Pattern, VisionModel
    from vision.pose.calibration import CalibrationError
    from vision.pose.estimate import FeatureSupport, PoseEstimate
    from vision.regions.attributes import AttributeConstraints
    from vision.regions.quadtree import SplitAndMergeParameters
    from vision.regions.region_ellipses import BoundaryFitParameters, region_ellipses
    from vision.regions.segmentation import Region, RegionGrowingParameters, Segmentation, segment

kernel_cache.settle()  # before any module with kernels is imported

__all__ = [
    "AttributeConstraints",
    "AttributeRange",
    "BoreCoordinates",
    "BoundaryFitParameters",
    "CalibrationError",
    "Camera",
    "Circle",
    "CircleFeature",
    "EdgeMap",
    "EdgeParameters",
    "Ellipse",
    "EllipseFeature",
    "EllipseLocalizer",
    "Extraction",
    "ExtractionThresholds",
    "FeatureSupport",
    "FileFormatError",
    "FilterParameters",
    "FocalpickError",
    "FragmentParameters",
    "GraspCoordinates",
    "Grouping",
    "GroupingParameters",
    "InputError",
    "Localization",
    "Localizer",
    "MatchingParameters",
    "Pattern",
    "PoseCheck",
    "PoseEstimate",
    "PoseReading",
    "Region",
    "RegionAttributes",
    "RegionGrowingParameters",
    "ResourceError",
    "Segmentation",
    "SplitAndMergeParameters",
    "View",
    "VisionModel",
    "Workspace",
    "check_poses",
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
    "drawing.superimpose": ("superimpose",),
    "edges.edge_map": (
        "EdgeMap",
        "EdgeParameters",
        "detect_edges",
    ),
    "errors": (
        "FileFormatError",
        "FocalpickError",
        "InputError",
        "ResourceError",
    ),
    "extraction": (
        "Extraction",
        "ExtractionThresholds",
    ),
    "features": (
        "EllipseFeature",
        "RegionAttributes",
    ),
    "files.picture": ("read_picture",),
    "files.views": (
        "load_views",
        "save_views",
    ),
    "geometry.camera": (
        "Camera",
        "View",
    ),
    "geometry.circle": ("Circle",),
    "geometry.ellipse": ("Ellipse",),
    "geometry.pose_reading": ("PoseReading",),
    "geometry.workspace": ("Workspace",),
    "grouping.detector": (
        "detect_ellipses",
        "find_ellipses",
    ),
    "grouping.edge_grouping": (
        "Grouping",
        "GroupingParameters",
        "group_edges",
        "group_ellipses",
    ),
    "grouping.fragments": ("FragmentParameters",),
    "grouping.kalman_filter": ("FilterParameters",),
    "localizer": (
        "EllipseLocalizer",
        "Localization",
        "Localizer",
        "extract_features",
    ),
    "matching.parameters": ("MatchingParameters",),
    "matching.pose_check": (
        "PoseCheck",
        "check_poses",
    ),
    "model.grasp": (
        "BoreCoordinates",
        "GraspCoordinates",
    ),
    "model.model_file": (
        "load_model",
        "save_model",
    ),
    "model.vision_model": (
        "AttributeRange",
        "CircleFeature",
        "Pattern",
        "VisionModel",
    ),
    "pose.calibration": ("CalibrationError",),
    "pose.estimate": (
        "FeatureSupport",
        "PoseEstimate",
    ),
    "regions.attributes": ("AttributeConstraints",),
    "regions.quadtree": ("SplitAndMergeParameters",),
    "regions.region_ellipses": (
        "BoundaryFitParameters",
        "region_ellipses",
    ),
    "regions.segmentation": (
        "Region",
        "RegionGrowingParameters",
        "Segmentation",
        "segment",
    ),
}
_HOME = {name: f"vision.{module}" for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
