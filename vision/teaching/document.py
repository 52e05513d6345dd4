"""The document of a teaching session: what has been taught so far. It never changes; edits give another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.features import Extractor
from vision.model.grasp import BoreCoordinates, GraspCoordinates
from vision.model.vision_model import Role
from vision.teaching import events as ev
from vision.teaching.lesson import Lesson, TaughtFeature
from vision.teaching.snapping import MINIMUM_CLICKS

Point = tuple[float, float]


@dataclass(frozen=True)
class MarkedFeature:
    """A feature as it stands in the document.

    Attributes:
        feature_id: identifies it; never changes.
        name: what the person calls it.
        role: salient or supporting.
        marks: the points in the order in which they were set, by number of the view; no view without points.
        copies: number of equal features evenly spaced around the axis.
        extractor: the person's choice, or None to take what the system proposes.
    """

    feature_id: str
    name: str
    role: Role
    marks: Mapping[int, tuple[Point, ...]] = field(default_factory=dict)
    copies: int = 1
    extractor: Extractor | None = None

    @property
    def contours(self) -> dict[int, tuple[Point, ...]]:
        """The marks of the views that have enough of them for an ellipse."""
        return {v: points for v, points in sorted(self.marks.items()) if len(points) >= MINIMUM_CLICKS}

    def taught(self) -> TaughtFeature:
        """The feature as a lesson wants it, from the views that have enough points.

        Fit it with :func:`vision.teaching.lesson.locate`, which takes the views' edge fields, made once.
        """
        clicks = {v: np.array(points) for v, points in self.contours.items()}
        return TaughtFeature(self.name, self.role, clicks, self.copies, self.extractor)


@dataclass(frozen=True)
class Document:
    """What has been taught so far.

    Attributes:
        part: name of the part, "" until it is described.
        diameter_m: outline diameter, 0 until it is described.
        symmetry_fold: number of rotations about z that look the same; None: all do.
        features: in the order in which they were added.
        grasps: as they were placed, without the time.
        bore: as it was pointed out, without the time.
        thresholds: of the extractors.
    """

    part: str = ""
    diameter_m: float = 0.0
    symmetry_fold: int | None = None
    features: tuple[MarkedFeature, ...] = ()
    grasps: tuple[ev.PlaceGrasp, ...] = ()
    bore: ev.SetBore | None = None
    thresholds: ExtractionThresholds = field(default_factory=ExtractionThresholds)

    def feature(self, feature_id: str) -> MarkedFeature:
        """The feature with an identifier.

        Raises:
            InputError: there is none.
        """
        for feature in self.features:
            if feature.feature_id == feature_id:
                return feature
        known = ", ".join(f.feature_id for f in self.features) or "none yet"
        raise InputError("feature", got=feature_id, expected=f"one of those in the document ({known})")

    def lesson(self) -> Lesson:
        """What the document teaches.

        Raises:
            InputError: when something is missing, saying what.
        """
        if not self.part or self.diameter_m <= 0:
            raise InputError("part", got="no description", expected="name and diameter", do="Describe the part.")
        for feature in self.features:
            if len(feature.contours) < 2:
                raise InputError(
                    f"feature {feature.name!r}",
                    got=f"{MINIMUM_CLICKS} or more points in {len(feature.contours)} views",
                    expected="at least two views",
                    do="Mark it in another view, or remove it.",
                )
        return Lesson(
            self.part,
            self.diameter_m,
            tuple(f.taught() for f in self.features),
            self.symmetry_fold,
            self.grasp_coordinates(),
            self.bore_coordinates(),
            self.thresholds,
        )

    def grasp_coordinates(self) -> tuple[GraspCoordinates, ...]:
        """The grasps as a vision model has them."""
        return tuple(
            GraspCoordinates(g.name, ev.pose_of(g.T_part_tcp), g.width_m, g.kind, g.copies) for g in self.grasps
        )

    def bore_coordinates(self) -> BoreCoordinates | None:
        """The bore as a vision model has it."""
        if self.bore is None:
            return None
        return BoreCoordinates(ev.pose_of(self.bore.T_part_bore), self.bore.diameter_m, self.bore.depth_m)
