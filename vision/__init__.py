"""From images to poses: edges, ellipses, matching. Knows nothing of simulators or robots."""

from vision.edges import EdgeMap, EdgeParameters, detect_edges
from vision.grouping import Grouping, GroupingParameters, detect_ellipses, group_edges, group_ellipses

__all__ = [
    "EdgeMap",
    "EdgeParameters",
    "Grouping",
    "GroupingParameters",
    "detect_edges",
    "detect_ellipses",
    "group_edges",
    "group_ellipses",
]
