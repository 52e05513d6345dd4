"""A lesson: everything a person says about a part, and the vision model that follows from it (Section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.features import EllipseFeature, Extractor
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse, overlap
from vision.model.grasp import BoreCoordinates, GraspCoordinates
from vision.model.vision_model import AttributeRange, CircleFeature, Role, VisionModel
from vision.teaching.circle_refinement import refine_circle
from vision.teaching.pattern import learn_patterns
from vision.teaching.snapping import snap_to_edge
from vision.teaching.triangulation import TriangulatedCircle, triangulate_circle

Array = NDArray[np.float64]

SAME_FEATURE_OVERLAP = 0.8


@dataclass(frozen=True, eq=False)
@frozen_arrays
class TaughtFeature:
    """One feature as the person marked it.

    Attributes:
        name: what the person calls it.
        role: salient or supporting.
        clicks: (N, 2) pixels near the contour, N >= 5, by number of the view.
        copies: number of equal features evenly spaced around the axis; one of them is marked.
        extractor: the person's choice, or None to take what the system proposes.
    """

    name: str
    role: Role
    clicks: Mapping[int, Array]
    copies: int = 1
    extractor: Extractor | None = None


@dataclass(frozen=True, eq=False)
class Lesson:
    """What a person taught.

    Attributes:
        part: name of the part.
        diameter_m: its outline diameter.
        features: the marked features.
        symmetry_fold: number of rotations about the axis that look the same.
        grasps: grasp coordinates.
        bore: the bore, where there is one.
        thresholds: of the extractors.
    """

    part: str
    diameter_m: float
    features: tuple[TaughtFeature, ...]
    symmetry_fold: int | None = None
    grasps: tuple[GraspCoordinates, ...] = ()
    bore: BoreCoordinates | None = None
    thresholds: ExtractionThresholds = field(default_factory=ExtractionThresholds)


def acquire(lesson: Lesson, views: Sequence[View], found: Sequence[Sequence[EllipseFeature]]) -> VisionModel:
    """The vision model that a lesson teaches: the marked circles, and the patterns that nobody has to mark.

    The world frame of the views is the part's frame: the part stands centred on the teaching fixture.

    Args:
        lesson: the marks.
        views: the views that the marks refer to, with distortion-free lenses.
        found: what the extractors found in each view, for the strategy and the attributes.

    Raises:
        InputError: for a feature whose marks do not make a circle.
    """
    edge_fields = [EdgeField.from_gray(v.gray) for v in views]
    features = tuple(_acquire_feature(f, views, edge_fields, found) for f in lesson.features)
    return VisionModel(
        lesson.part,
        lesson.diameter_m,
        features,
        lesson.symmetry_fold,
        lesson.grasps,
        lesson.bore,
        lesson.thresholds,
        learn_patterns(views, features, lesson.diameter_m, lesson.symmetry_fold),
    )


def locate(feature: TaughtFeature, views: Sequence[View], edge_fields: Sequence[EdgeField]) -> TriangulatedCircle:
    """Snap the clicks of a feature to the edges, triangulate its circle, and settle it where the views agree.

    A turned part's rims share its axis, and its holes are parallel to it: what the marks say within a tolerance is
    taken as that, which leaves them less to determine.
    """
    marks = {v: snap_to_edge(clicks, edge_fields[v])[1] for v, clicks in feature.clicks.items()}
    try:
        found = triangulate_circle(views, marks, coaxial=feature.role == "salient")
    except InputError as error:
        raise InputError(
            f"feature {feature.name!r}", got=error.got, expected=error.expected, do=error.do or "Mark it again."
        ) from error
    agreeing = set(marks) - set(found.inconsistent())
    return replace(found, circle=refine_circle(found.circle, found.freedom, sorted(agreeing), views, edge_fields))


def _acquire_feature(
    feature: TaughtFeature,
    views: Sequence[View],
    edge_fields: Sequence[EdgeField],
    found: Sequence[Sequence[EllipseFeature]],
) -> CircleFeature:
    circle = _to_micrometre(locate(feature, views, edge_fields).circle)
    images = {v: project_circle(circle, views[v]) for v in feature.clicks}
    seen = {v: _same(image, found[v]) for v, image in images.items() if image is not None}
    return CircleFeature(
        name=feature.name,
        role=feature.role,
        circle=circle,
        extractor=feature.extractor or propose_extractor(list(seen.values())),
        copies=feature.copies,
        support=_edge_support(images, edge_fields),
        attributes=_attribute_ranges([f for v, s in seen.items() for f in s if _fills(f, images[v])]),
    )


def _to_micrometre(circle: Circle) -> Circle:
    """The circle as a model's file has it, so that all that is measured with it is the same on every machine."""
    return Circle(np.round(circle.centre, 6), np.round(circle.normal, 7), round(circle.radius_m, 6))


def propose_extractor(seen: Sequence[Sequence[EllipseFeature]]) -> Extractor:
    """The extractor that found the feature in more views; region growing where both did equally well."""
    region, group = (sum(any(f.extractor == p for f in view) for view in seen) for p in ("region", "group"))
    return "group" if group > region else "region"


def _same(image: Ellipse, found: Sequence[EllipseFeature]) -> list[EllipseFeature]:
    """The extracted ellipses that are this feature."""
    near = [f for f in found if np.hypot(*(f.ellipse.centre - image.centre)) < 0.2 * image.semi_axes[0] + 2]
    return [f for f in near if overlap(f.ellipse, image) > SAME_FEATURE_OVERLAP]


def _fills(found: EllipseFeature, image: Ellipse | None) -> bool:
    """Whether the region whose attributes a feature carries lies inside the ellipse, not around it."""
    return image is not None and found.attributes is not None and found.attributes.area_px < 1.05 * image.area


def _edge_support(images: Mapping[int, Ellipse | None], edge_fields: Sequence[EdgeField]) -> float:
    """Mean edge support of the feature's image over the views in which it was marked."""
    supports = []
    for v, image in images.items():
        if image is None:
            continue
        # Off by a thousandth of a pixel: by symmetry some points lie on the very border of two pixels, and on which
        # side of it would depend on the last bit.
        contour = image.sample(96) + 1e-3
        supports.append(float(edge_fields[v].support(contour, image.normals(contour)).mean()))
    return float(np.mean(supports)) if supports else 0.0


def _attribute_ranges(seen: Sequence[EllipseFeature]) -> tuple[tuple[str, AttributeRange], ...]:
    measured = [f.attributes for f in seen if f.attributes is not None]
    if not measured:
        return ()
    names = [f.name for f in fields(measured[0])]
    values = {name: [getattr(a, name) for a in measured] for name in names}
    return tuple((name, AttributeRange(min(v), max(v))) for name, v in values.items())
