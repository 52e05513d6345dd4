"""Holds a localizer's answer against the truth, piece by piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from benchmark.episodes.metrics import (
    BARELY_VISIBLE,
    Assignment,
    assign,
    hull_points,
    is_extracted,
    match_limit_mm,
    mssd_mm,
    normalized_error,
    pose_errors,
    pose_offset,
)
from benchmark.models import load_model
from benchmark.records.episode_record import LocalizerResult, PieceRecord
from benchmark.world.parts import get_part, vertices
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse, overlap
from vision.localizer import PRESETS, Localization
from vision.model.projection import GRAZING_COSINE
from vision.pose.estimate import PoseEstimate

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TruePiece:
    """One piece as the simulator knows it.

    Attributes:
        part: name of its type.
        T_world_part: its true pose.
        visibility: visible share of its silhouette, mean over the views.
        in_bin: False when it bounced out.
    """

    part: str
    T_world_part: RigidTransform
    visibility: float
    in_bin: bool


@dataclass(frozen=True, eq=False)
class Verdict:
    """The truth about a localizer's answer.

    Attributes:
        pieces: one record for each piece.
        false_positives: by method, the number of poses that belong to no piece.
        owner: for each of the localizer's estimates, the piece it belongs to or None.
        false_probabilities: by method, with which it says of the false poses that they are right, where it says so.
    """

    pieces: tuple[PieceRecord, ...]
    false_positives: dict[str, int]
    owner: tuple[int | None, ...]
    false_probabilities: dict[str, tuple[float, ...]] = field(default_factory=dict)

    def beside(self, other: Verdict) -> Verdict:
        """This verdict with the results of another localizer on the same pieces."""
        pieces = tuple(
            replace(mine, results={**mine.results, **theirs.results})
            for mine, theirs in zip(self.pieces, other.pieces, strict=True)
        )
        return replace(
            self,
            pieces=pieces,
            false_positives={**self.false_positives, **other.false_positives},
            false_probabilities={**self.false_probabilities, **other.false_probabilities},
        )


def judge(
    localization: Localization,
    method: str,
    pieces: Sequence[TruePiece],
    true_views: Sequence[View],
    models: str | None = None,
) -> Verdict:
    """Compare a localization, and what each of its extractors would have said alone, with the truth.

    Args:
        localization: the answer.
        method: name of the localizer.
        pieces: the truth.
        true_views: the images with the true camera poses, to project the true salient ellipses.
        models: directory of vision models that come before the shipped ones.
    """
    answers = {**localization.by_extractor, method: localization.estimates}
    assignments = {name: assign_estimates(estimates, pieces) for name, estimates in answers.items()}
    records = []
    for index, piece in enumerate(pieces):
        ellipses = _salient_ellipses(piece, true_views, models)
        results = {
            name: _result(index, piece, answers[name], assignments[name], _extracted(name, ellipses, localization))
            for name in answers
        }
        stage = _failed_stage(piece, results[method])
        records.append(PieceRecord(index, piece.part, piece.visibility, piece.in_bin, results, stage))
    owner = dict(assignments[method].pairs)
    return Verdict(
        tuple(records),
        {name: len(a.false_positives) for name, a in assignments.items()},
        tuple(owner.get(i) for i in range(len(localization.estimates))),
        {name: _probabilities([answers[name][i] for i in a.false_positives]) for name, a in assignments.items()},
    )


def assign_estimates(estimates: Sequence[PoseEstimate], pieces: Sequence[TruePiece]) -> Assignment:
    """Pair estimates with pieces, one to one, below the matching limit."""

    def cost(estimate: PoseEstimate, piece: TruePiece) -> float:
        if estimate.part != piece.part:
            return float("inf")
        return mssd_mm(estimate.T_world_part, piece.T_world_part, get_part(piece.part).symmetry, _hull(piece.part))

    return assign(estimates, pieces, cost, lambda piece: match_limit_mm(get_part(piece.part).diameter_m))


def _result(
    index: int, piece: TruePiece, estimates: Sequence[PoseEstimate], assignment: Assignment, extracted: bool
) -> LocalizerResult:
    mine = next((i for i, j in assignment.pairs if j == index), None)
    if mine is None:
        return LocalizerResult(extracted, matched=False)
    symmetry, estimate = get_part(piece.part).symmetry, estimates[mine]
    pose, truth = estimate.T_world_part, piece.T_world_part
    errors = pose_errors(pose, truth, symmetry, _hull(piece.part))
    normalized = normalized_error(pose, estimate.covariance, truth, symmetry, inplane_known=estimate.inplane_known)
    offset = pose_offset(pose, truth, symmetry, inplane_known=estimate.inplane_known)
    return LocalizerResult(
        extracted,
        matched=True,
        errors=errors,
        normalized=normalized,
        offset=offset,
        probability=estimate.probability,
    )


def _probabilities(estimates: Sequence[PoseEstimate]) -> tuple[float, ...]:
    return tuple(estimate.probability for estimate in estimates if estimate.probability is not None)


def _extracted(name: str, ellipses: Sequence[Sequence[Ellipse | None]], localization: Localization) -> bool:
    """Whether a salient circle of the piece was extracted in enough views; never for methods without features.

    Args:
        name: of the method; a preset of the localizer sees what its own extractors found.
        ellipses: of each circle the images in all views, as of ``_salient_ellipses``.
        localization: with the features of all views.
    """
    if not localization.features:
        return False
    mine = [
        [f for f in found if name not in PRESETS or f.extractor in PRESETS[name]] for found in localization.features
    ]
    return is_extracted(
        [
            [0.0 if image is None else _best_overlap(image, found) for image, found in zip(images, mine, strict=True)]
            for images in ellipses
        ]
    )


def _best_overlap(expected: Ellipse, found: Sequence[EllipseFeature]) -> float:
    """Largest intersection over union with any found ellipse of about the same place and size."""
    size = expected.semi_axes[0]
    near = [
        f.ellipse
        for f in found
        if np.hypot(*(f.ellipse.centre - expected.centre)) < 0.3 * size and 0.7 < f.ellipse.semi_axes[0] / size < 1.4
    ]
    return max((overlap(expected, e) for e in near), default=0.0)


def _salient_ellipses(piece: TruePiece, views: Sequence[View], models: str | None) -> list[list[Ellipse | None]]:
    """Of each taught salient circle the images in all views, at the piece's true pose; None where it faces away."""
    circles = [feature.circle.moved(piece.T_world_part) for feature in load_model(piece.part, models).salient]
    return [[_image(circle, view) for view in views] for circle in circles]


def _image(circle: Circle, view: View) -> Ellipse | None:
    towards = view.T_world_camera.translation - circle.centre
    faces = circle.normal @ towards > GRAZING_COSINE * np.linalg.norm(towards)
    return project_circle(circle, view) if faces else None


def _failed_stage(piece: TruePiece, result: LocalizerResult) -> str | None:
    if not piece.in_bin:
        return "drop"
    if result.matched:
        return None
    if piece.visibility < BARELY_VISIBLE:
        return "visibility"
    return "matching" if result.extracted else "extraction"


@cache
def _hull(part: str) -> Array:
    return hull_points(vertices(get_part(part)).copy())
