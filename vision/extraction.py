"""Both extractors on one image: what each stage found, and the ellipses that go on to matching (Section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.extraction_thresholds import ExtractionThresholds
from vision.features import EllipseFeature, Process
from vision.grouping import Grouping, group_edges
from vision.region_attributes import AttributeConstraints
from vision.regions import region_ellipses
from vision.segmentation import Segmentation, segment


@dataclass(frozen=True, eq=False)
class Extraction:
    """What the extractors found in one image.

    Attributes:
        segmentation: of region growing; None where that was not asked for.
        constraints: by which its regions were pruned; None prunes nothing.
        grouping: of edge grouping; None where that was not asked for.
        features: the ellipses, those of region growing first.
    """

    segmentation: Segmentation | None
    constraints: AttributeConstraints | None
    grouping: Grouping | None
    features: tuple[EllipseFeature, ...]

    def of_process(self, process: Process) -> tuple[EllipseFeature, ...]:
        """The ellipses that one extractor found."""
        return tuple(feature for feature in self.features if feature.process == process)


def run_extractors(
    gray: NDArray[np.uint8],
    processes: Sequence[Process],
    constraints: AttributeConstraints | None = None,
    thresholds: ExtractionThresholds | None = None,
) -> Extraction:
    """Run extractors on the image of a distortion-free lens and keep what every stage found.

    Args:
        gray: (H, W) uint8 grey levels.
        processes: which extractors.
        constraints: prune the regions that no taught part can have; None prunes nothing.
        thresholds: of the extractors; None for their own.
    """
    thresholds = thresholds or ExtractionThresholds()
    segmentation, grouping = None, None
    found: list[EllipseFeature] = []
    if "region" in processes:
        growing = thresholds.growing
        segmentation = segment(gray, growing)
        found += region_ellipses(segmentation, gray, constraints, thresholds.boundary_fit, growing)
    if "group" in processes:
        grouping = group_edges(gray, thresholds.grouping)
        found += grouping.features
    return Extraction(segmentation, constraints, grouping, tuple(found))
